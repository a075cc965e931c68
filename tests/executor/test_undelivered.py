"""What is left of a connection that closes while its peer does not take what was sent, with real sockets."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from executor.undelivered import close_in_order, discard_at_close, undelivered
from tests.waiting import until

CHUNK = 65536
WITHIN_S = 0.02


class UnreadPair:
    """A connection to a peer that reads nothing until it is asked to."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # what an accepted socket begins with
            self.own = socket.create_connection(server.getsockname())
            self.peer = server.accept()[0]
        self.sent = 0

    def fill(self) -> None:
        """Sends until the kernel takes no more."""
        self.own.setblocking(False)
        try:
            while True:
                self.sent += self.own.send(bytes(CHUNK))
        except BlockingIOError:
            return

    def received(self) -> tuple[int, bool]:
        """Returns how much the peer receives, and whether the connection was reset."""
        self.peer.settimeout(10.0)
        count = 0
        try:
            while data := self.peer.recv(CHUNK):
                count += len(data)
        except ConnectionResetError:
            return count, True
        return count, False

    def assert_cut(self) -> None:
        """Asserts that the peer receives no more than its own kernel had taken, and a reset."""
        count, is_reset = self.received()
        assert count < CHUNK < self.sent
        assert is_reset


@pytest.fixture
def pair() -> Iterator[UnreadPair]:
    found = UnreadPair()
    yield found
    found.own.close()
    found.peer.close()


def test_the_kernel_delivers_what_a_closed_socket_has_left(pair: UnreadPair) -> None:
    """What this module is for: without it a command arrives after its run."""
    pair.fill()
    assert undelivered(pair.own) > 0
    pair.own.close()
    assert pair.received() == (pair.sent, False)


def test_what_has_not_arrived_is_dropped(pair: UnreadPair) -> None:
    discard_at_close(pair.own)
    pair.fill()
    assert not close_in_order(pair.own, WITHIN_S)
    assert undelivered(pair.own) > CHUNK
    pair.own.close()
    pair.assert_cut()


def test_what_has_arrived_is_closed_in_order(pair: UnreadPair) -> None:
    discard_at_close(pair.own)
    pair.own.sendall(b"last")
    assert close_in_order(pair.own, 10.0)
    pair.own.close()
    assert pair.received() == (4, False)


def test_a_killed_process_leaves_nothing(pair: UnreadPair) -> None:
    """Its sockets are closed by the kernel, with the option that they had."""
    discard_at_close(pair.own)
    pair.fill()
    command = [sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(600)"]
    with subprocess.Popen(command, pass_fds=[pair.own.fileno()], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        pair.own.close()  # the child has it, too
        os.kill(process.pid, signal.SIGKILL)
    pair.assert_cut()


def test_a_socket_that_is_gone_is_no_error(pair: UnreadPair) -> None:
    discard_at_close(pair.own)
    pair.own.close()
    assert not close_in_order(pair.own, WITHIN_S)


def test_a_delayed_acknowledgement_is_waited_for(pair: UnreadPair) -> None:
    pair.own.sendall(b"x")
    until(lambda: undelivered(pair.own) == 0, within_s=10.0)
