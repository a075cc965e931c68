"""Shared memory and stream job: one side reads what the other has written."""

from __future__ import annotations

import os

import numpy as np

from executor import shared_memory as shm
from executor.shared_memory import ROW, TEXT_BYTES, SharedMemory
from executor.stream_job import StreamJob
from tests.executor.conftest import Prepared


def test_rows_come_out_as_they_went_in() -> None:
    memory = SharedMemory.create(3)
    other = SharedMemory.attach(os.dup(memory.fd))
    width = ROW.size // 8
    for i in range(5):
        memory.add_row(list(np.arange(width) + 100.0 * i))
    assert other.fields[shm.ROWS] == 5  # counted, though there was room for three
    rows = np.frombuffer(other.row_bytes()).reshape(-1, width)
    assert rows[:, 0].tolist() == [0.0, 100.0, 200.0]
    assert np.frombuffer(other.row_bytes(2))[1] == 201.0
    other.close()
    memory.close()


def test_a_text_longer_than_its_field_is_cut() -> None:
    memory = SharedMemory.create(1)
    memory.write_text("x" * 5000)
    assert memory.text() == "x" * TEXT_BYTES
    memory.write_text("short")
    assert memory.text() == "short"
    memory.close()


def test_a_job_survives_the_way_to_the_other_process(prepared: Prepared) -> None:
    fd = prepared.job.write()
    assert StreamJob.read(fd) == prepared.job
    os.close(fd)
