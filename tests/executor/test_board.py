"""The board and the job: what one side writes, the other reads."""

from __future__ import annotations

import os

import numpy as np

from executor import board as words
from executor.board import ROW, TEXT_BYTES, Board
from executor.job import Job
from tests.executor.conftest import Prepared


def test_rows_come_out_as_they_went_in() -> None:
    board = Board.create(3)
    other = Board.attach(os.dup(board.fd))
    width = ROW.size // 8
    for i in range(5):
        board.add_row(list(np.arange(width) + 100.0 * i))
    assert other.words[words.ROWS] == 5  # counted, though there was room for three
    rows = np.frombuffer(other.row_bytes()).reshape(-1, width)
    assert rows[:, 0].tolist() == [0.0, 100.0, 200.0]
    assert np.frombuffer(other.row_bytes(2))[1] == 201.0
    other.close()
    board.close()


def test_a_text_longer_than_its_field_is_cut() -> None:
    board = Board.create(1)
    board.write_text("x" * 5000)
    assert board.text() == "x" * TEXT_BYTES
    board.write_text("short")
    assert board.text() == "short"
    board.close()


def test_a_job_survives_the_way_to_the_other_process(prepared: Prepared) -> None:
    fd = prepared.job.write()
    assert Job.read(fd) == prepared.job
    os.close(fd)
