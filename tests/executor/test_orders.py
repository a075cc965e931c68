"""Orders from outside the loop."""

from __future__ import annotations

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


def test_nothing_is_asked(board: Board) -> None:
    assert Orders(board, SILENT_S).stop() is None


def test_an_abort_is_heard(board: Board) -> None:
    board.words[ABORT] = 1.0
    assert Orders(board, SILENT_S).stop() == ("aborted", "abort requested")


def test_a_signal_is_heard(board: Board) -> None:
    orders = Orders(board, SILENT_S)
    orders._terminate(15, None)
    assert orders.stop() == ("executor_lost", "the executor ended")


def test_a_silent_daemon_is_noticed(board: Board) -> None:
    board.words[DAEMON_PULSE] = time.monotonic() - 2 * SILENT_S
    outcome, reason = Orders(board, SILENT_S).stop() or ("", "")
    assert outcome == "executor_lost"
    assert "silent" in reason
