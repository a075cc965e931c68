"""The sockets that ur_rtde opens in this process: their options, and whether they are still those of the beginning."""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator
from contextlib import suppress

from executor.rtde_packages import RTDE_PORT
from executor.undelivered import close_in_order, discard_at_close


class LibrarySockets:
    """The RTDE sockets of this process at the time of construction, which sets options of every TCP socket.

    What such a socket has not delivered is dropped when this process ends, killed or not, and however it ends: no
    command reaches the controller after that, once a cable is in again.

    ur_rtde 1.6.5 sets TCP_NODELAY on a socket that its connect then closes and reopens. Without it, the last of four
    outputs arrived up to 43 ms late.

    Attributes:
        count: number of connected RTDE sockets found; fewer than there are interfaces if one is lost already.
    """

    def __init__(self) -> None:
        self._inodes: dict[int, int] = {}
        for descriptor, connection in _tcp_sockets():
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            discard_at_close(connection)
            if _peer_port(connection) == RTDE_PORT:
                self._inodes[descriptor] = os.fstat(connection.fileno()).st_ino
        self.count = len(self._inodes)

    def were_replaced(self) -> bool:
        """Whether an RTDE socket has been closed since, or another one opened in its place; takes microseconds.

        The library reconnects by itself, on a quiet machine within 7 ms, and goes on commanding (measured with ur_rtde
        1.6.5): nothing else shows it then.
        """
        try:
            return any(os.fstat(descriptor).st_ino != inode for descriptor, inode in self._inodes.items())
        except OSError:
            return True

    def close_in_order(self) -> bool:
        """Has what was sent over every RTDE socket arrive before this process ends; returns whether all has."""
        arrived = True
        for descriptor in self._inodes:
            with suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as copy:
                arrived = close_in_order(copy) and arrived
        return arrived


def _tcp_sockets() -> Iterator[tuple[int, socket.socket]]:
    """Yields the descriptor of every TCP socket of this process, with a copy to read and set its options."""
    for name in os.listdir("/proc/self/fd"):
        try:
            if not stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            copy = socket.socket(fileno=os.dup(int(name)))
        except OSError:
            continue  # closed meanwhile, as the directory's own descriptor is
        with copy:
            if copy.family in (socket.AF_INET, socket.AF_INET6) and copy.type == socket.SOCK_STREAM:
                yield int(name), copy


def _peer_port(connection: socket.socket) -> int | None:
    try:
        return connection.getpeername()[1]
    except OSError:
        return None  # not connected, or no longer
