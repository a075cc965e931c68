"""A run of the streaming process: what it leaves behind, and how it ends where nothing can be started."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from executor.stream_process import SpareStream
from executor.supervision import StreamRun
from tests.executor.conftest import Prepared


def descriptors() -> list[str]:
    """Returns what the descriptors of this process lead to."""
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
