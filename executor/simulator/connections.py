"""TCP connections of the controller: listening, reading, sending, and everything a network does wrong on request."""

from __future__ import annotations

import random
import socket
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

BACKLOG = 16
CONNECTIONS_MAX = 100  # a port scan does not starve the loop
READ_MAX = 65536
UNSENT_MAX = 1 << 20  # [bytes] a client that reads nothing for so long is dropped
RESET = struct.pack("ii", 1, 0)  # SO_LINGER: close with RST instead of FIN


@dataclass
class Disturbance:
    """What the network does to a connection: a stall, a delay [s], and a share of lost packages."""

    stalled: bool = False
    delay_s: float = 0.0
    drop: float = 0.0
    draw: random.Random = field(default_factory=lambda: random.Random(0))

    def loses(self) -> bool:
        """Returns whether this package is lost."""
        return self.drop > 0.0 and self.draw.random() < self.drop


class Connection:
    """One accepted socket with its buffers."""

    def __init__(self, sock: socket.socket, port: str) -> None:
        self.socket, self.port = sock, port
        self.received, self.unsent = bytearray(), bytearray()
        self.later: deque[tuple[float, bytes, bool]] = deque()  # (due, data, whether it is incoming)
        self.disturbance = Disturbance()
        self.open = True

    def send(self, data: bytes, now: float) -> None:
        """Sends, as far as the socket takes it; the rest follows with `flush`."""
        if self.disturbance.delay_s > 0.0 or self.later:
            self.later.append((now + self.disturbance.delay_s, data, False))
        else:
            self.unsent += data
            self.flush()

    def flush(self) -> None:
        """Sends what has not been sent."""
        if not self.unsent or self.disturbance.stalled or not self.open:
            return
        try:
            del self.unsent[: self.socket.send(self.unsent)]
        except (BlockingIOError, InterruptedError):
            self.open = len(self.unsent) < UNSENT_MAX
        except OSError:
            self.open = False

    def read(self, now: float) -> bool:
        """Reads what has arrived; returns whether there is something new in `received`."""
        try:
            data = self.socket.recv(READ_MAX)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:
            data = b""
        if not data:
            self.open = False
        elif self.disturbance.delay_s > 0.0:
            self.later.append((now + self.disturbance.delay_s, data, True))
        else:
            self.received += data
            return True
        return False

    def wake(self, now: float) -> bool:
        """Delivers delayed data that is due; returns whether something arrived by it."""
        arrived = False
        while self.later and self.later[0][0] <= now and self.open:
            _, data, incoming = self.later.popleft()
            if incoming:
                self.received += data
                arrived = True
            else:
                self.unsent += data
                self.flush()
        return arrived

    def close(self, reset: bool = False) -> None:
        """Closes the socket, with a reset if asked for."""
        self.open = False
        if reset:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self.socket.close()


@dataclass
class Port:
    """One service: its number, what to do with a new connection, with new data and with a lost connection."""

    name: str
    number: int
    opened: Callable[[Connection], None]
    arrived: Callable[[Connection], None]
    closed: Callable[[Connection], None]
    mute: bool = False  # a fault: accepts, but never answers


def listen(host: str, number: int) -> socket.socket:
    """Returns a listening, non-blocking socket.

    Raises:
        OSError: the address cannot be had.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, number))
        sock.listen(BACKLOG)
    except OSError:
        sock.close()
        raise
    sock.setblocking(False)
    return sock


class Network:
    """All listening sockets and connections of one controller on one address."""

    def __init__(self, host: str, ports: list[Port]) -> None:
        self.host, self.ports = host, ports
        self.listeners: dict[socket.socket, Port] = {}
        self.connections: dict[socket.socket, tuple[Connection, Port]] = {}
        self.changed()
        self.listen()

    def listen(self) -> None:
        """Listens on every port it does not listen on yet."""
        up = {port.name for port in self.listeners.values()}
        for port in self.ports:
            if port.name not in up:
                self.listeners[listen(self.host, port.number)] = port
        self.changed()

    def unlisten(self, keep: str) -> None:
        """Stops listening everywhere but on port `keep`: connections are refused."""
        for sock, port in list(self.listeners.items()):
            if port.name != keep:
                sock.close()
                del self.listeners[sock]
        self.changed()

    def changed(self) -> None:
        """Renews the list of sockets to wait for."""
        reading = [s for s, (c, _) in self.connections.items() if not c.disturbance.stalled]
        self.sockets = [*self.listeners, *reading]

    def readable(self, sock: socket.socket, now: float) -> None:
        """Serves a socket that has something to read."""
        if sock in self.listeners:
            self._accept(sock)
        elif sock in self.connections:
            connection, port = self.connections[sock]
            if connection.read(now) and not port.mute:
                port.arrived(connection)
            self._sweep(connection)

    def tick(self, now: float) -> None:
        """Sends what is left over and due, drops what has ended."""
        for connection, port in list(self.connections.values()):
            if connection.later and connection.wake(now) and not port.mute:
                port.arrived(connection)
            if connection.unsent:
                connection.flush()
            self._sweep(connection)

    def drop(self, connection: Connection, reset: bool = False) -> None:
        """Closes a connection."""
        found = self.connections.pop(connection.socket, None)
        if found is None:
            return
        connection.close(reset)
        self.changed()
        found[1].closed(connection)

    def close(self) -> None:
        """Closes everything."""
        for connection, _ in list(self.connections.values()):
            self.drop(connection)
        self.unlisten(keep="")

    def _sweep(self, connection: Connection) -> None:
        if not connection.open:
            self.drop(connection)

    def _accept(self, listener: socket.socket) -> None:
        try:
            sock, _ = listener.accept()
        except OSError:
            return
        if len(self.connections) >= CONNECTIONS_MAX:
            sock.close()
            return
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        port = self.listeners[listener]
        connection = Connection(sock, port.name)
        self.connections[sock] = (connection, port)
        self.changed()
        if not port.mute:
            port.opened(connection)
