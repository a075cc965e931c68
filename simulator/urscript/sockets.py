"""The TCP connections that a script opens to servers, by name. Nothing here blocks: who waits asks again."""

from __future__ import annotations

import errno
import ipaddress
import select
import socket

from simulator.interfaces import Connection

OPEN_MAX = 50  # sockets of one script; a script that leaks them does not starve the process
NAMES = {"localhost": "127.0.0.1"}  # numeric addresses beside: looking up a name would hold up the cycle
RECEIVED_MAX = 65536  # [bytes] chosen: of what a script has not read yet; one read more than that at most
STARTED = (0, errno.EINPROGRESS)


class ScriptSockets:
    """Open sockets of one script."""

    def __init__(self) -> None:
        self.by_name: dict[str, Connection] = {}

    def start(self, address: str, port: int) -> socket.socket | None:
        """Begins to connect; None if that fails at once.

        Raises:
            ValueError: there are too many sockets, or the address is not numeric.
        """
        if len(self.by_name) >= OPEN_MAX:
            raise ValueError(f"more than {OPEN_MAX} sockets are open")
        numeric = NAMES.get(address, address)
        try:
            ipaddress.IPv4Address(numeric)
        except ValueError as error:
            raise ValueError(f"{address!r} is no numeric IPv4 address") from error
        try:
            sock = socket.socket()
        except OSError:  # there are no more
            return None
        sock.setblocking(False)
        try:
            if sock.connect_ex((numeric, port)) in STARTED:
                return sock
        except (OSError, OverflowError):  # the latter: no port
            pass
        sock.close()
        return None

    def finished(self, sock: socket.socket, name: str) -> bool | None:
        """Returns whether a connection came about, under this name from now on; None while that is open."""
        if not select.select((), (sock,), (), 0.0)[1]:
            return None
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            sock.close()
            return False
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.close(name)
        self.by_name[name] = Connection(sock)
        return True

    def received(self, name: str) -> bytearray | None:
        """Returns what a socket has received and nobody has read; None if there is no such socket, or it has ended.

        Once that is too much, nothing more is read: TCP holds the sender back.
        """
        connection = self.by_name.get(name)
        if connection is None:
            return None
        connection.flush()
        if connection.open and len(connection.received) <= RECEIVED_MAX:
            connection.read()
        return connection.received if connection.open or connection.received else None

    def send(self, name: str, data: bytes) -> bool:
        """Sends; returns whether the socket is open."""
        connection = self.by_name.get(name)
        if connection is None or not connection.open:
            return False
        connection.send(data)
        return connection.open

    def close(self, name: str) -> None:
        """Closes a socket, if there is one of that name."""
        connection = self.by_name.pop(name, None)
        if connection is not None:
            connection.close()

    def close_all(self) -> None:
        """Closes every socket."""
        for name in list(self.by_name):
            self.close(name)
