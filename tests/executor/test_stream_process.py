"""The streaming process as its executor sees it: its end, its freezing, and the one that waits for an execution."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from executor.stream_process import SPARE_LOG, STREAM_LOG, STREAM_MODULE, ChildProcess, SpareStream, end_orphan
from tests.executor.conftest import waiting_process
from tests.processes import children_with
from tests.waiting import until


def sleeping(tmp_path: Path) -> ChildProcess:
    return ChildProcess(["sleep", "60"], (), tmp_path / "log")


def test_a_killed_child_is_known_to_have_been_killed(tmp_path: Path) -> None:
    child = sleeping(tmp_path)
    assert not child.ends_within(0.0)
    assert not child.is_frozen()
    assert child.poll() is None
    child.kill()
    assert child.ends_within(60.0)
    assert child.was_killed
    child.reap()
    assert not child.is_frozen()


def test_a_frozen_child_is_seen_and_can_be_killed(tmp_path: Path) -> None:
    child = sleeping(tmp_path)
    os.kill(child.pid, signal.SIGSTOP)
    until(child.is_frozen)
    assert not child.ends_within(0.0)
    child.kill()
    child.reap()
    assert child.poll() == -signal.SIGKILL


def test_a_child_that_fails_by_itself_leaves_its_last_line(tmp_path: Path) -> None:
    child = ChildProcess([sys.executable, "-c", "raise SystemExit('it broke')"], (), tmp_path / "log")
    assert child.ends_within(60.0)
    child.reap()
    assert not child.was_killed
    assert child.last_line() == ["it broke"]


LOCKS = "import fcntl, sys, time; fcntl.lockf(sys.stdout, fcntl.LOCK_EX); print('locked', flush=True); time.sleep(60)"


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGCONT], ids=["frozen", "hanging"])
def test_a_stream_that_an_executor_left_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    monkeypatch.setattr("executor.stream_process.ORPHAN_S", 0.1)
    log = tmp_path / "log"
    child = ChildProcess([sys.executable, "-c", LOCKS, STREAM_MODULE], (), log)
    until(lambda: "locked" in log.read_text())
    os.kill(child.pid, number)
    assert end_orphan(log) == child.pid
    child.reap()
    assert child.was_killed
    assert end_orphan(log) is None


def test_nobody_is_ended_where_no_stream_is_left(tmp_path: Path) -> None:
    assert end_orphan(tmp_path / "log") is None  # there was no run yet
    child = ChildProcess([sys.executable, "-c", LOCKS.replace("60", "0.1")], (), tmp_path / "log")
    child.reap()
    assert end_orphan(tmp_path / "log") is None


def test_a_process_that_is_no_stream_keeps_its_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("executor.stream_process.ORPHAN_S", 0.1)
    log = tmp_path / "log"
    child = ChildProcess([sys.executable, "-c", LOCKS], (), log)
    until(lambda: "locked" in log.read_text())
    assert end_orphan(log) is None
    assert child.poll() is None
    child.kill()
    child.reap()


@pytest.fixture
def spare(tmp_path: Path) -> Iterator[SpareStream]:
    waiting = SpareStream(tmp_path)
    yield waiting
    waiting.close()


def test_a_waiting_process_has_no_connection_to_anything(spare: SpareStream) -> None:
    spare.prepare()
    process = waiting_process()
    assert process.net_connections("inet") == []
    spare.prepare()
    assert children_with(STREAM_MODULE) == [process]  # one is enough
    spare.close()
    assert children_with(STREAM_MODULE) == []


def test_the_process_that_waits_is_taken_with_its_log(spare: SpareStream, tmp_path: Path) -> None:
    spare.prepare()
    process = waiting_process()
    taken = spare.take()
    assert taken.pid == process.pid
    assert taken.log == tmp_path / STREAM_LOG
    assert not (tmp_path / SPARE_LOG).exists()
    taken.kill()
    taken.reap()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["dead", "frozen"])
def test_one_that_died_or_was_frozen_is_replaced(spare: SpareStream, number: signal.Signals) -> None:
    spare.prepare()
    process = waiting_process()
    process.send_signal(number)
    until(lambda: process.status() in ("zombie", "stopped"))
    taken = spare.take()
    assert taken.pid != process.pid
    assert not process.is_running()
    taken.kill()
    taken.reap()


def test_one_whose_log_was_deleted_is_replaced(spare: SpareStream, tmp_path: Path) -> None:
    spare.prepare()
    process = waiting_process()
    (tmp_path / SPARE_LOG).unlink()
    taken = spare.take()
    assert taken.log.is_file()
    assert not process.is_running()
    taken.kill()
    taken.reap()


def test_without_one_a_new_one_is_taken(spare: SpareStream, tmp_path: Path) -> None:
    taken = spare.take()
    assert taken.log == tmp_path / STREAM_LOG
    taken.kill()
    taken.reap()


def test_one_whose_executor_is_there_no_more_ends(spare: SpareStream) -> None:
    spare.prepare()
    waiting_process()
    waiting = spare._waiting
    assert waiting is not None
    waiting._channel.close()
    assert waiting.ends_within(60.0)
    assert waiting.poll() == 0


EXECUTOR = """
import sys, time
from pathlib import Path
from executor.stream_process import SpareStream
from tests.waiting import until
spare = SpareStream(Path(sys.argv[1]))
spare.prepare()
print("ready", flush=True)
time.sleep(600)
"""


def test_the_kernel_ends_one_whose_executor_is_killed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", EXECUTOR, str(tmp_path)], stdout=subprocess.PIPE) as executor:
        assert executor.stdout is not None
        try:
            assert executor.stdout.readline() == b"ready\n"
            (process,) = children_with(STREAM_MODULE, executor.pid)
        finally:
            executor.kill()
    psutil.wait_procs([process], 60.0)
    assert not process.is_running()
    assert end_orphan(tmp_path / SPARE_LOG) is None
