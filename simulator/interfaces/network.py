"""Ports and connections of one controller on one address."""

from __future__ import annotations

import random
import socket
from dataclasses import dataclass, replace

from simulator.interfaces.connections import Connection, ConnectionHandler, Disturbance

BACKLOG = 16  # connections waiting to be accepted on a port
CONNECTIONS_MAX = 100  # a port scan cannot starve the loop


@dataclass
class ServicePort:
    """A service on a TCP port."""

    name: str
    number: int
    handler: ConnectionHandler
    mute: bool = False  # fault: accepts, but never answers


class Network:
    """All listening sockets and connections of one controller on one address.

    Attributes:
        sockets: sockets to wait for.
        disturbance: what a new connection begins with, but of the port named `undisturbed`.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self.ports: list[ServicePort] = []
        self.listeners: dict[socket.socket, ServicePort] = {}
        self.connections: dict[socket.socket, tuple[Connection, ServicePort]] = {}
        self.sockets: list[socket.socket] = []
        self.disturbance = Disturbance()
        self.undisturbed = ""

    def add(self, *ports: ServicePort) -> None:
        """Adds ports and listens on them.

        Raises:
            OSError: an address is not available.
        """
        self.ports += ports
        self.listen()

    def listen(self) -> None:
        """Listens on every port without a listener."""
        up = {port.name for port in self.listeners.values()}
        for port in self.ports:
            if port.name not in up:
                sock = socket.create_server((self.host, port.number), backlog=BACKLOG)
                sock.setblocking(False)
                self.listeners[sock] = port
        self.changed()

    def unlisten(self, keep: str) -> None:
        """Stops listening on every port except `keep`: connections are refused."""
        for sock, port in list(self.listeners.items()):
            if port.name != keep:
                sock.close()
                del self.listeners[sock]
        self.changed()

    def changed(self) -> None:
        """Renews the list of sockets to wait for."""
        reading = [s for s, (c, _) in self.connections.items() if not c.disturbance.stalled]
        self.sockets = [*self.listeners, *reading]

    def readable(self, sock: socket.socket) -> None:
        """Serves a socket that is ready to read."""
        if sock in self.listeners:
            self._accept(sock)
        elif sock in self.connections:
            connection, port = self.connections[sock]
            if connection.read() and not port.mute:
                port.handler.arrived(connection)
            self._drop_if_closed(connection)

    def tick(self) -> None:
        """Sends remaining and due data, drops closed connections."""
        for connection, port in list(self.connections.values()):
            if connection.delayed and connection.deliver_delayed() and not port.mute:
                port.handler.arrived(connection)
            if connection.unsent:
                connection.flush()
            self._drop_if_closed(connection)

    def drop(self, connection: Connection, reset: bool = False) -> None:
        """Closes a connection, with RST instead of FIN if `reset`."""
        found = self.connections.pop(connection.socket, None)
        if found is None:
            return
        connection.close(reset)
        self.changed()
        found[1].handler.closed(connection)

    def close(self) -> None:
        """Closes all connections and listeners."""
        for connection, _ in list(self.connections.values()):
            self.drop(connection)
        self.unlisten(keep="")

    def _drop_if_closed(self, connection: Connection) -> None:
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
        self.connect(sock, self.listeners[listener])

    def connect(self, sock: socket.socket, port: ServicePort) -> Connection:
        """Serves a connected, non-blocking socket as a connection to `port`."""
        connection = Connection(sock)
        if port.name != self.undisturbed:
            connection.disturbance = replace(self.disturbance, draw=random.Random(len(self.connections)))
        if port.mute:  # its service never learns of this connection, not even of its end
            port = replace(port, handler=ConnectionHandler())
        self.connections[sock] = (connection, port)
        self.changed()
        if not port.mute:
            port.handler.opened(connection)
        return connection
