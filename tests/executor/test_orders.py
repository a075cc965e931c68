"""Orders from outside the loop."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest

from executor.board import ABORT, DAEMON_PULSE, Board
from executor.streaming.orders import Orders

SILENT_S = 0.1


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board.create(1)
    board.words[DAEMON_PULSE] = time.monotonic() + 60.0
    yield board
    board.close()


def listening(board: Board) -> Orders:
    """Returns orders whose daemon is this process."""
    return Orders(board, SILENT_S, os.getpid(), threading.get_native_id())


def test_nothing_is_asked(board: Board) -> None:
    assert listening(board).stop() is None


def test_an_abort_is_heard(board: Board) -> None:
    board.words[ABORT] = 1.0
    assert listening(board).stop() == ("aborted", "abort requested")


def test_a_signal_is_heard(board: Board) -> None:
    orders = listening(board)
    orders._terminate(15, None)
    assert orders.stop() == ("executor_lost", "the executor ended")


def test_a_silent_daemon_is_noticed(board: Board) -> None:
    board.words[DAEMON_PULSE] = time.monotonic() - 2 * SILENT_S
    outcome, reason = listening(board).stop() or ("", "")
    assert outcome == "executor_lost"
    assert "silent" in reason


def test_a_frozen_daemon_is_noticed_at_once_and_a_dead_one_too(board: Board) -> None:
    daemon = subprocess.Popen(["sleep", "60"])
    orders = Orders(board, SILENT_S, daemon.pid, daemon.pid)
    assert orders.stop() is None
    daemon.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, daemon.pid, os.WSTOPPED | os.WNOWAIT)
    assert orders.stop() == ("executor_lost", "the executor was frozen")
    daemon.send_signal(signal.SIGCONT)
    daemon.kill()
    daemon.wait()
    assert orders.stop() == ("executor_lost", "the executor was frozen")
