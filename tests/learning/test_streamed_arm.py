"""The streamed arm against a finer integration of the same loop, and against what a lag must do."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.learning.plans import PlannedThrow
from learning.streamed_arm import StreamedArm

STEP_S = 1e-4


ANY_SPEED = np.full(6, 99.0)


def integrated(
    planned: PlannedThrow, arm: StreamedArm, assumed_s: float, at: float, qd_max: np.ndarray = ANY_SPEED
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and speeds off the plan: the loop in steps of 0.1 ms, its commands continuous."""
    trajectory = planned.trajectory
    back = round(arm.lag_s / STEP_S)
    q = trajectory.q[0].copy()
    sent: list[np.ndarray] = []
    times = np.arange(-0.1, at, STEP_S)
    plan_q = trajectory.at(times)[0]
    ahead = trajectory.at(times + assumed_s)[1]
    ahead[times + assumed_s < 0.0] = 0.0
    speed = np.zeros(6)
    for k in range(len(times)):
        sent.append(np.clip(ahead[k] + np.clip(5.0 * (plan_q[k] - q), -0.25, 0.25), -qd_max, qd_max))
        speed = arm.gain * sent[k - back] if k >= back else np.zeros(6)
        q = q + STEP_S * speed
    final_q, final_qd, _ = trajectory.at(times[-1])
    return q - final_q, speed - final_qd


@pytest.mark.parametrize(("lag_s", "assumed_s"), [(0.020, 0.020), (0.026, 0.020), (0.0333, 0.040)])
def test_deviations_are_those_of_a_finer_integration(soonest: list[PlannedThrow], lag_s: float, assumed_s: float):
    planned = soonest[0]
    arm = StreamedArm(lag_s, np.array([1.03, 0.98, 1.02, 1.0, 0.97, 1.0]))
    at = planned.trajectory.release_time_s
    q, qd = arm.deviation(planned.trajectory, assumed_s, ANY_SPEED, np.array([at]))
    fine_q, fine_qd = integrated(planned, arm, assumed_s, at)
    assert q[0] == pytest.approx(fine_q, abs=3e-4)
    assert qd[0] == pytest.approx(fine_qd, abs=4e-3)


def test_a_slow_arm_is_not_sent_faster_than_its_joints_may_be(soonest: list[PlannedThrow]):
    """Where the plan is at the joints' limits already, feedback cannot make up for a slow arm."""
    planned = soonest[0]
    arm = StreamedArm(0.020, np.full(6, 0.94))
    at = planned.trajectory.release_time_s
    qd_max = np.abs(planned.trajectory.qd).max(axis=0)
    q, qd = arm.deviation(planned.trajectory, 0.020, qd_max, np.array([at]))
    fine_q, fine_qd = integrated(planned, arm, 0.020, at, qd_max)
    assert q[0] == pytest.approx(fine_q, abs=3e-4)
    assert qd[0] == pytest.approx(fine_qd, abs=4e-3)
    free_q, free_qd = arm.deviation(planned.trajectory, 0.020, ANY_SPEED, np.array([at]))
    assert max(np.abs(q - free_q).max() / 3e-4, np.abs(qd - free_qd).max() / 4e-3) > 3.0


def test_an_exact_arm_does_what_was_planned(soonest: list[PlannedThrow]):
    planned = soonest[0]
    times = planned.trajectory.release_time_s + np.linspace(-0.1, 0.1, 21)
    q, qd = StreamedArm(0.020, np.ones(6)).deviation(planned.trajectory, 0.020, ANY_SPEED, times)
    assert np.abs(q).max() < 1e-5
    assert np.abs(qd).max() < 2e-3


def test_an_arm_that_is_too_fast_stays_near_its_plan(soonest: list[PlannedThrow]):
    """Its error is filtered by the feedback: of a gain 1 + g it stays below g v / (5/s), wherever v is the fastest."""
    planned = soonest[0]
    fastest = np.abs(planned.trajectory.qd).max(axis=0)
    times = np.arange(0.0, planned.trajectory.duration_s, 0.01)
    q, _ = StreamedArm(0.020, np.full(6, 1.05)).deviation(planned.trajectory, 0.020, ANY_SPEED, times)
    assert np.all(np.abs(q).max(axis=0) <= 0.05 * fastest / 5.0 + 1e-4)
    assert np.abs(q).max() > 0.01
