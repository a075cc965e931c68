"""Requests to stop from outside the loop."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest

from executor.shared_memory import ABORT, DAEMON_PULSE, SharedMemory
from executor.streaming.stop_requests import StopRequests

SILENT_S = 0.1


@pytest.fixture
def memory() -> Iterator[SharedMemory]:
    memory = SharedMemory.create(1)
    memory.fields[DAEMON_PULSE] = time.monotonic() + 60.0
    yield memory
    memory.close()


def listening(memory: SharedMemory) -> StopRequests:
    """Returns requests whose daemon is this process."""
    return StopRequests(memory, SILENT_S, os.getpid(), threading.get_native_id())


def test_without_a_request_nothing_is_pending(memory: SharedMemory) -> None:
    assert listening(memory).pending() is None


def test_an_abort_is_heard(memory: SharedMemory) -> None:
    memory.fields[ABORT] = 1.0
    assert listening(memory).pending() == ("aborted", "abort requested")


def test_a_signal_is_heard(memory: SharedMemory) -> None:
    requests = listening(memory)
    requests._terminate(15, None)
    assert requests.pending() == ("executor_lost", "the executor ended")


def test_a_silent_daemon_is_noticed(memory: SharedMemory) -> None:
    memory.fields[DAEMON_PULSE] = time.monotonic() - 2 * SILENT_S
    outcome, reason = listening(memory).pending() or ("", "")
    assert outcome == "executor_lost"
    assert "silent" in reason


def test_a_frozen_daemon_is_noticed_at_once_and_a_dead_one_too(memory: SharedMemory) -> None:
    daemon = subprocess.Popen(["sleep", "60"])
    requests = StopRequests(memory, SILENT_S, daemon.pid, daemon.pid)
    assert requests.pending() is None
    daemon.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, daemon.pid, os.WSTOPPED | os.WNOWAIT)
    assert requests.pending() == ("executor_lost", "the executor was frozen")
    daemon.send_signal(signal.SIGCONT)
    daemon.kill()
    daemon.wait()
    assert requests.pending() == ("executor_lost", "the executor was frozen")
