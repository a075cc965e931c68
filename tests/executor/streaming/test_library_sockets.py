"""Whether a socket of the library is still the one of the beginning, with real sockets on loopback."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import pytest

from executor.realtime import RunDelay
from executor.streaming import library_sockets
from executor.streaming.library_sockets import LibrarySockets
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.state_checks import StreamFault


@pytest.fixture
def listener(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A server whose port stands for the RTDE port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        monkeypatch.setattr(library_sockets, "RTDE_PORT", server.getsockname()[1])
        yield server


def connected(listener: socket.socket) -> socket.socket:
    return socket.create_connection(listener.getsockname())


def test_the_same_socket_was_not_replaced(listener: socket.socket) -> None:
    with connected(listener):
        sockets = LibrarySockets()
        assert sockets.count == 1
        assert not sockets.were_replaced()


def test_a_socket_without_a_connection_does_not_count(listener: socket.socket) -> None:
    with socket.socket():
        assert LibrarySockets().count == 0


def test_no_descriptor_is_left_open(listener: socket.socket) -> None:
    """Of the socket itself: what other tests have left may be closed meanwhile."""
    with connected(listener) as socket_here:
        inode = os.fstat(socket_here.fileno()).st_ino
        LibrarySockets()
        assert descriptors_of(inode) == 1


def descriptors_of(inode: int) -> int:
    """Returns how many descriptors of this process lead to a socket."""
    found = 0
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # closed meanwhile
            found += os.fstat(int(number)).st_ino == inode
    return found


def test_a_replaced_socket_ends_a_run(listener: socket.socket) -> None:
    connection = RtdeConnection.__new__(RtdeConnection)  # without a controller
    interface = SimpleNamespace(isConnected=lambda: True)
    connection.receive = connection.control = cast(Any, interface)
    connection.writer = None
    connection._run_delay = RunDelay()
    connection._delay_s = 0.0
    with connected(listener):
        connection._sockets = LibrarySockets()
    with pytest.raises(StreamFault, match="replaced") as fault:
        connection.read()
    assert fault.value.outcome == "link_lost"


def test_a_socket_closed_by_the_other_side_alone_was_not_replaced(listener: socket.socket) -> None:
    with connected(listener):
        sockets = LibrarySockets()
        listener.accept()[0].close()
        assert not sockets.were_replaced()


def test_a_closed_socket_was_replaced(listener: socket.socket) -> None:
    with connected(listener):
        sockets = LibrarySockets()
    assert sockets.were_replaced()


def test_a_new_socket_of_the_same_number_was_replaced(listener: socket.socket) -> None:
    """As the library does: it closes a connection, and the next one gets the descriptor's number."""
    with connected(listener) as first, connected(listener) as second:
        sockets = LibrarySockets()
        os.dup2(second.fileno(), first.fileno())
        assert sockets.were_replaced()


def test_another_ports_socket_may_go(listener: socket.socket) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, connected(listener):
        foreign = socket.create_connection(other.getsockname())
        sockets = LibrarySockets()
        foreign.close()
        assert not sockets.were_replaced()


def test_no_delay_is_set_on_every_tcp_socket(listener: socket.socket) -> None:
    with connected(listener) as own, socket.socket(socket.AF_INET, socket.SOCK_DGRAM):  # the other kind has no delay
        LibrarySockets()
        assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
