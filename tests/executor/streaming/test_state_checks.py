"""Controller states and outside requests that end a run, and commands that are never sent."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest

from executor.shared_memory import ABORT, DAEMON_PULSE, SharedMemory
from executor.streaming.state_checks import StopRequests, StreamFault, check_command, check_state

LIMITS = [3.0] * 6
SILENT_S = 0.1


def test_normal_operation_passes() -> None:
    check_state(1, 2, 1.0)
    check_command([3.0, -3.0, 0.0, 0.0, 0.0, 0.0], LIMITS)


@pytest.mark.parametrize(
    ("bits", "runtime", "scaling", "outcome", "word"),
    [
        (1 << 2 | 1 << 10, 4, 1.0, "protective_stop", "protective stop"),
        (1 << 2 | 1 << 10, 2, 1.0, "protective_stop", "protective stop"),  # though the program goes on playing
        (1 << 4, 2, 1.0, "protective_stop", "safeguard stop"),
        (1 | 1 << 1, 2, 1.0, "protective_stop", "reduced mode"),
        (1 << 6 | 1 << 7 | 1 << 10, 1, 1.0, "emergency_stop", "robot emergency stop"),
        (1 << 5, 2, 1.0, "emergency_stop", "system emergency stop"),
        (0, 2, 1.0, "protective_stop", "unknown"),
        (1, 1, 1.0, "aborted", "stopped"),
        (1, 4, 1.0, "aborted", "paused"),
        (1, 2, 0.5, "aborted", "speed scaling"),
        (1, 2, math.nan, "aborted", "speed scaling"),
    ],
)
def test_anything_else_ends_the_run(bits: int, runtime: int, scaling: float, outcome: str, word: str) -> None:
    with pytest.raises(StreamFault) as caught:
        check_state(bits, runtime, scaling)
    assert caught.value.outcome == outcome
    assert word in caught.value.reason


@pytest.mark.parametrize(
    ("bits", "mode", "outcome"), [(1, 3, "power_off"), (1, -1, "power_off"), (1 << 6 | 1 << 7, 3, "emergency_stop")]
)
def test_an_arm_without_power_is_told_from_a_program_that_was_stopped(bits: int, mode: int, outcome: str) -> None:
    with pytest.raises(StreamFault) as caught:
        check_state(bits, 1, 1.0, mode)
    assert caught.value.outcome == outcome


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3.0001, -3.0001])
def test_a_command_out_of_bounds_is_never_sent(bad: float) -> None:
    with pytest.raises(StreamFault, match=r"bug in Fling: joint 3 was commanded .*, limit 3"):
        check_command([0.0, 0.0, bad, 0.0, 0.0, 0.0], LIMITS)


@pytest.mark.parametrize("count", [0, 5, 7])
def test_a_command_of_another_length_is_never_sent(count: int) -> None:
    with pytest.raises(StreamFault, match=f"bug in Fling: a command has {count} numbers, not 6"):
        check_command([0.0] * count, LIMITS)


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
