"""An execution's public states, and what is told of its end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from executor import shared_memory as shm
from executor.execution import Execution
from executor.streaming.state_checks import NORMAL, StreamFault, check_state


@pytest.mark.parametrize(("rows", "brakes"), [(150, False), (311, False), (312, True)])
def test_a_motion_brakes_from_its_last_passage_on(rows: int, brakes: bool) -> None:
    """Its main state may come long before: a throw, with a line of 50 ticks after it."""
    nothing: Any = None
    execution: Any = Execution(nothing, nothing)
    job = SimpleNamespace(first_clock_s=-0.02, dt=0.002, lag_ticks=1.0, release_row=110)
    problem = SimpleNamespace(passages=[SimpleNamespace(ticks=lambda _, n=n: n) for n in (0, 50)])
    trajectory = SimpleNamespace(passed=(100, 250), dt=0.002, sample_rate_hz=500.0)
    execution.motions = [SimpleNamespace(problem=problem, trajectory=trajectory)]
    execution.run = SimpleNamespace(taken=0, job=job, state=shm.STREAMING, furthest=shm.STREAMING, row_count=rows)
    assert ("braking" in execution.states()) is brakes


EMERGENCY = 1 << 6 | 1 << 7
NO_POWER = "the arm has no power (robot mode 3)"
PROGRAM = "the program on the controller is stopped"


@pytest.mark.parametrize(
    ("streamed", "seen", "outcome", "reason"),
    [
        ((NORMAL, 2, 3), (NORMAL, 3), "power_off", NO_POWER),
        ((NORMAL, 1, 7), (NORMAL, 3), "power_off", f"{NO_POWER}: {PROGRAM}"),
        ((NORMAL, 1, 7), (4, 7), "protective_stop", f"protective stop: {PROGRAM}"),
        (
            (NORMAL, 2, 3),
            (EMERGENCY, 3),
            "emergency_stop",
            f"robot emergency stop, emergency stop: {NO_POWER}",
        ),
        ((4, 2, 7), (4, 7), "protective_stop", "protective stop"),
        ((NORMAL, 1, 7), None, "aborted", PROGRAM),
    ],
)
def test_what_stream_and_daemon_both_saw_is_told_once(
    monkeypatch: pytest.MonkeyPatch, streamed: tuple[int, int, int], seen: Any, outcome: str, reason: str
) -> None:
    """`streamed` are safety bits, program and robot mode; `seen`, by the daemon, bits and mode."""
    bits, program, mode = streamed
    with pytest.raises(StreamFault) as fault:
        check_state(bits, program, 1.0, mode)
    ended: Any = SimpleNamespace(in_order=False, outcome=fault.value.outcome, reason=fault.value.reason)
    stop = None if seen is None else SimpleNamespace(safety_bits=seen[0], robot_mode=seen[1])
    session: Any = SimpleNamespace(monitor=SimpleNamespace(stop_seen=stop, state=None))
    nothing: Any = None
    monkeypatch.setattr("executor.execution.MONITOR_WAIT_S", 0.0)
    assert Execution(session, nothing)._outcome(ended) == (outcome, reason)
