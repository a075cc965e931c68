"""What a connection notes of its commands, over stand-ins for the library's interfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from time import monotonic
from types import SimpleNamespace
from typing import Any, cast

import pytest

from executor import shared_memory as shm
from executor.realtime import RunDelay
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.state_checks import PLAYING, StreamFault

QD_MAX = [3.0] * 6
STOPPED = 1


@pytest.fixture
def connection() -> Iterator[RtdeConnection]:
    found = RtdeConnection.__new__(RtdeConnection)  # without a controller
    found.job = cast(Any, SimpleNamespace(watchdog_hz=0.0, qd_max=QD_MAX, acceleration=40.0, dt=0.002))
    found.memory = shm.SharedMemory.create(10)
    found.control = cast(Any, SimpleNamespace(setWatchdog=lambda hz: True, speedJ=lambda *_: True))
    found.writer = cast(Any, SimpleNamespace(set_output=lambda *_: True))
    found._run_delay = RunDelay()
    yield found
    found.memory.close()


def test_the_controllers_watchdog_counts_from_its_arming_and_from_each_motion_command(
    connection: RtdeConnection,
) -> None:
    """By this a stop of the watchdog is told from a stop on the pendant, before the first command, too."""
    assert connection.sent_at == math.inf
    before = monotonic()
    connection.arm_watchdog()
    armed = connection.sent_at
    assert before <= armed <= monotonic()
    connection.output("tool_digital", 0, True)  # the watchdog does not hear it
    assert connection.sent_at == armed
    connection.speed([0.1] * 6)
    assert armed < connection.sent_at <= monotonic()


class LaterStates:
    """A receive interface whose states are behind those of the control interface by some readings."""

    def __init__(self, behind: int) -> None:
        self.behind = behind

    def getRuntimeState(self) -> int:
        self.behind -= 1
        return STOPPED if self.behind > 0 else PLAYING


@pytest.mark.parametrize(("behind", "state"), [(1, PLAYING), (5, PLAYING), (10**6, STOPPED)])
def test_a_program_that_has_started_is_waited_for_in_the_states(
    connection: RtdeConnection, monkeypatch: pytest.MonkeyPatch, behind: int, state: int
) -> None:
    """Both connections tell of one cycle, but not at one instant: a run was ended for a program that played."""
    receive = LaterStates(behind)
    connection.plays = True
    monkeypatch.setattr(connection, "read", lambda: setattr(connection, "runtime_state", receive.getRuntimeState()))
    connection.read()
    connection._await_program()
    assert connection.runtime_state == state


def gone(*_: object) -> None:
    raise RuntimeError("Timeout connecting to UR dashboard server.")


@pytest.mark.parametrize("name", ["setWatchdog", "speedStop", "servoStop", "stopScript"])
def test_a_call_that_fails_is_a_lost_link(connection: RtdeConnection, name: str) -> None:
    """The library raises where it cannot connect again; the arm may be at rest after a throw by then."""
    control = {"setWatchdog": lambda hz: True, "speedStop": lambda a: True, "servoStop": lambda: True}
    connection.control = cast(Any, SimpleNamespace(**{**control, "stopScript": lambda: None, name: gone}))
    connection.job.dry_run = False
    connection.job.mode = "servoj" if name == "servoStop" else "speedj"
    connection.qd = [0.0] * 6

    def arm_and_stop() -> None:
        connection.arm_watchdog()
        connection.stop()

    with pytest.raises(StreamFault, match=f"{name}: Timeout") as fault:
        arm_and_stop()
    assert fault.value.outcome == "link_lost"
