"""Whether a socket of the library is still the one of the beginning, with real sockets on loopback."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator

import pytest

from executor.streaming import library_sockets
from executor.streaming.library_sockets import LibrarySockets


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
        assert not sockets.were_replaced()


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
    with connected(listener) as own, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        LibrarySockets()
        assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
        assert udp.fileno() >= 0  # left alone
