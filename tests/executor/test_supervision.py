"""A run of the streaming process: what it leaves behind, and how it ends where nothing can be started."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executor import shared_memory as shm
from executor.stream_job import StreamJob
from executor.stream_process import SpareStream
from executor.supervision import StreamRun
from tests.executor.conftest import Prepared


def descriptors() -> list[str]:
    """Returns what the descriptors of this process lead to, once nothing is left of other tests."""
    gc.collect()
    found = []
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # that of the listing itself
            found.append(os.readlink(f"/proc/self/fd/{number}"))
    return sorted(found)


def ended_run(prepared: Prepared, tmp_path: Path, host: str) -> StreamRun:
    run = StreamRun(replace(prepared.job, host=host), SpareStream(tmp_path), keep_awake=False)
    run.start()
    assert run.wait(60.0)
    return run


def test_a_run_leaves_no_descriptor_and_no_thread_behind(prepared: Prepared, tmp_path: Path) -> None:
    before = (descriptors(), threading.active_count())
    for _ in range(3):
        run = ended_run(prepared, tmp_path, "127.0.42.3")  # nobody listens there
        assert run.result is not None
        assert run.result.outcome == "refused"
        run.abort()  # comes too late, and harms nobody
        assert (run.latest_row(), run.row_count) == (None, 0)
    assert (descriptors(), threading.active_count()) == before


def greet(dashboard: socket.socket) -> socket.socket:
    """Accepts a client of a dashboard and greets it; returns the connection."""
    connection, _ = dashboard.accept()
    connection.sendall(b"hello\n")
    return connection


def test_the_primary_interface_alone_is_enough_to_start(
    prepared: Prepared, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PolyScope X has no dashboard."""
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with socket.create_server(("127.0.42.5", 30001)):
        run = ended_run(prepared, tmp_path, "127.0.42.5")
    assert run.result is not None
    assert "starting the streaming process" in run.result.reason


@pytest.mark.parametrize(
    ("number", "outcome"), [("SEGV", "link_lost"), ("ABRT", "link_lost"), ("KILL", "executor_lost")]
)
def test_a_crash_of_the_library_is_a_lost_link_and_ends_the_program(
    prepared: Prepared, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: str, outcome: str
) -> None:
    """ur_rtde crashes as it reconnects to a controller without a dashboard; nobody but the library raises these."""
    crashing = tmp_path / "python"
    crashing.write_text(f"#!/bin/sh\nulimit -c 0\nkill -{number} $$\n")
    crashing.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crashing))
    with socket.create_server(("127.0.42.7", 30001)) as primary:
        run = ended_run(prepared, tmp_path, "127.0.42.7")
        with primary.accept()[0] as connection:
            assert connection.recv(100) == b"stop program\n"
    assert run.result is not None
    assert run.result.outcome == outcome
    assert ("ur_rtde crashed" in run.result.reason) is (outcome == "link_lost")


def test_without_a_way_to_stop_nothing_starts(prepared: Prepared, tmp_path: Path) -> None:
    run = ended_run(prepared, tmp_path, "127.0.42.6")
    assert run.result is not None
    assert "no way to stop the controller at 127.0.42.6" in run.result.reason


def test_a_stream_that_cannot_be_started_leaves_none_either(
    prepared: Prepared, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with socket.create_server(("127.0.42.4", 29999)) as dashboard, ThreadPoolExecutor() as pool:
        greeted = pool.submit(greet, dashboard)
        before = [link for link in descriptors() if "memfd" in link]
        run = ended_run(prepared, tmp_path, "127.0.42.4")
        greeted.result().close()
    assert run.result is not None
    assert "starting the streaming process" in run.result.reason
    assert [link for link in descriptors() if "memfd" in link] == before


class Asked:
    """Ways to stop a controller and to hold an object; notes what is asked of them."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def hold(self, job: StreamJob) -> bool:
        self.asked.append("hold")
        return True

    def end_blowing(self, job: StreamJob) -> bool:
        self.asked.append("end blowing")
        return True

    def stop(self) -> None:
        self.asked.append("stop program")

    def ask(self, line: str) -> str:
        self.asked.append(line)
        return ""

    def kill(self) -> None:
        pass

    def reap(self) -> None:
        pass

    def close(self) -> None:
        pass


def run_at(job: StreamJob, row: int, tmp_path: Path) -> tuple[StreamRun, list[str]]:
    """Returns a run whose process has failed after its row, and what is asked of the controller from then on."""
    run = StreamRun(job, SpareStream(tmp_path), keep_awake=False)
    ways: Any = Asked()
    run.outputs = run.programs = run.dashboard = run._child = ways
    clock_s = job.first_clock_s + (row - job.lag_ticks) * job.dt
    told = {"clock_s": clock_s, "host_s": time.monotonic()}
    run.memory.add_row([told.get(name, 0.0) for name in shm.SCALARS] + [0.0] * (shm.ROW.size // 8 - len(shm.SCALARS)))
    return run, ways.asked


def test_a_dry_run_leaves_the_controller_alone(prepared: Prepared, tmp_path: Path) -> None:
    """Whatever a person moves with it meanwhile."""
    job = replace(prepared.job, dry_run=True)
    run, asked = run_at(job, job.output_row + 1, tmp_path)
    run.memory.fields[shm.OUTPUT_SENT_S] = 0.1
    run._make_safe("fault")
    assert asked == []


def test_an_object_is_held_until_its_release_only(prepared: Prepared, tmp_path: Path) -> None:
    job = prepared.job
    for row, told, done in (
        (job.output_row - 20, False, ["stop program", "stop"]),
        (job.output_row, True, ["hold", "stop program", "stop"]),
        (job.release_row + math.ceil(job.lag_ticks) + 50, True, ["end blowing", "stop program", "stop"]),
    ):
        run, asked = run_at(job, row, tmp_path)
        if told:
            run.memory.fields[shm.OUTPUT_SENT_S] = 0.1
        run._make_safe("fault")
        assert asked == done


def test_what_a_program_in_the_controller_has_opened_unseen_is_closed(prepared: Prepared, tmp_path: Path) -> None:
    """It plays on until it is stopped, and opens the gripper after the newest state."""
    job = replace(prepared.job, program="def fling(): end")
    run, asked = run_at(job, job.output_row - 2, tmp_path)
    run._make_safe("fault")
    assert asked == ["hold", "stop program", "hold", "stop"]
    run, asked = run_at(replace(job, output_row=-1), 50, tmp_path)  # which throws nothing
    run._make_safe("fault")
    assert asked == ["stop program", "stop"]
