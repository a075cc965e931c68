"""The approach, streamed by the loop itself: to an arm that is late, does not follow, or stands somewhere else."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from executor.preparation import prepare_job
from executor.streaming.approach import START_RAD, approach
from executor.streaming.loop import ARRIVED_RAD
from planner.approach import find_approach
from tests.executor.conftest import Prepared, settings
from tests.executor.streaming.test_landing_watch import OffArm

AWAY = np.array([0.8, 0.2, -0.2, 0.1, 0.3, 0.0])  # [rad] from where the plan begins
NOBODY = SimpleNamespace(pending=lambda: None)


def arm_away(prepared: Prepared, lag_s: float, gain: float = 1.0, pace: float = 1.0) -> OffArm:
    """An arm at rest, away from the plan's start, and a job that leads there."""
    cell = prepared.cell
    start = prepared.trajectory.q[0]
    way, failures = find_approach(cell, start + AWAY, start, pace)
    assert way is not None and way.is_straight, failures
    job = prepare_job(prepared.problem, prepared.trajectory, way, "speedj", False, settings(cell.name))
    arm = OffArm(job, lag_s, np.full(6, gain))
    arm.true_q = start + AWAY
    arm.q = arm.true_q.tolist()
    return arm


@pytest.mark.parametrize(("lag_s", "gain"), [(0.02, 0.97), (0.02, 1.03), (0.1, 1.0)])
def test_an_arm_arrives_however_late_and_off_its_speed(prepared: Prepared, lag_s: float, gain: float) -> None:
    arm = arm_away(prepared, lag_s, gain)
    assert approach(arm, NOBODY) is None
    assert np.abs(arm.true_q - prepared.trajectory.q[0]).max() < ARRIVED_RAD
    assert np.abs(arm.true_qd).max() < 0.01
    assert not arm.opened


def test_an_approach_ends_with_its_last_row_where_the_arm_has_arrived(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    approach(arm, NOBODY)
    assert arm.tick <= len(arm.job.approach.q) + 1


def test_an_arm_that_does_not_follow_is_stopped(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02, gain=0.5)
    outcome, reason = approach(arm, NOBODY)
    assert outcome == "tracking", reason
    assert arm.sent[-1] == pytest.approx(np.zeros(6), abs=arm.job.feedback_max + 1e-6)


def test_an_arm_that_was_moved_meanwhile_is_refused_at_rest(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    arm.q[2] += 2.0 * START_RAD
    outcome, reason = approach(arm, NOBODY)
    assert outcome == "refused"
    assert "was moved by 0.020 rad" in reason
    assert not arm.sent


def test_at_the_start_nothing_moves(prepared: Prepared) -> None:
    arm = OffArm(prepared.job, 0.02, np.ones(6))
    arm.q = list(prepared.job.q[0])
    assert approach(arm, NOBODY) is None
    assert not arm.sent


def test_an_abort_on_the_way_brakes(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    requests = SimpleNamespace(pending=lambda: ("aborted", "abort requested") if arm.tick * arm.job.dt > 0.6 else None)
    assert approach(arm, requests) == ("aborted", "abort requested")
    fastest = max(max(map(abs, qd)) for qd in arm.sent)
    assert fastest > 0.5
    assert np.abs(arm.true_qd).max() < 0.01
    assert arm.tick * arm.job.dt < 0.6 + 0.1
