"""The room that joints need to reach a velocity and to lose it: against Ruckig's motions, and as a user meets it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import ruckig

from planner.errors import Infeasible
from planner.planning import plan
from planner.problem import JointRelease, ThrowProblem
from planner.seeds import candidates
from planner.seeds.turning_room import lack_of_room
from tests.planner.problems import cell


def turned(start: float, q: float, v: float, acceleration: float, jerk: float) -> tuple[float, float]:
    """Returns the least and the largest position [rad] of Ruckig's soonest motion of one joint from rest to q, v."""
    asked = ruckig.InputParameter(1)
    asked.current_position, asked.current_velocity, asked.current_acceleration = [start], [0.0], [0.0]
    asked.target_position, asked.target_velocity, asked.target_acceleration = [q], [v], [0.0]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [abs(v) + 1.0], [acceleration], [jerk]
    found = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(asked, found) == ruckig.Result.Working
    positions = [found.at_time(t)[0][0] for t in np.linspace(0.0, found.duration, 2001)]  # not its extrema
    return min(positions), max(positions)


def test_no_motion_of_ruckig_needs_less_room_and_some_hardly_more() -> None:
    here, rng, spare = cell(), np.random.default_rng(1), []
    limits = replace(here.limits, qdd_max=np.full(6, 15.0), jerk_max=np.full(6, 1e6))
    for _ in range(200):
        q, v = rng.uniform(-1.0, 1.0), rng.uniform(-3.0, 3.0)
        least, most = turned(rng.uniform(-1.0, 1.0), q, v, 15.0, 1e6)
        bounded = replace(limits, q_lower=np.full(6, least), q_upper=np.full(6, 10.0))
        bounded = bounded if v > 0.0 else replace(limits, q_lower=np.full(6, -10.0), q_upper=np.full(6, most))
        problem = ThrowProblem(here, np.clip(np.zeros(6), bounded.q_lower, bounded.q_upper), joint(q, v), bounded)
        lack = lack_of_room(problem, np.full((1, 6), q), np.full((1, 6), v))[0, 0]
        assert lack <= 1e-5  # between two samples
        spare.append(-lack)
    assert min(spare) < 1e-3


def joint(q: float, v: float) -> JointRelease:
    return JointRelease(np.full(6, q), np.full(6, v))


@pytest.mark.parametrize(("speed", "what"), [(2.4, "begin to accelerate"), (-2.4, "come to a stop")])
def test_a_release_too_close_to_a_barrier_is_refused_with_proof(speed: float, what: str) -> None:
    here = cell()
    q, qd = here.home.copy(), np.zeros(6)
    q[4], qd[4] = -2.93, speed
    with pytest.raises(Infeasible) as refusal:
        plan(ThrowProblem(here, here.home, JointRelease(q, qd), here.limits))
    (violation,) = refusal.value.violations
    assert violation.constraint == "joint_position"
    assert violation.proven
    assert violation.value == pytest.approx(-2.93 - 2.4**2 / 2.0 / here.limits.qdd_max[4])
    assert -3.07 < violation.limit < -3.06
    assert what in violation.detail
    assert "wrist_1 and tool_0 collide before" in violation.detail


def test_a_release_too_close_to_a_joint_limit_is_refused_by_that_limit() -> None:
    here = cell()
    q, qd = here.home.copy(), np.zeros(6)
    q[0], qd[0] = 6.2, 2.5
    with pytest.raises(Infeasible) as refusal:
        candidates(ThrowProblem(here, here.home, JointRelease(q, qd), here.limits))
    (violation,) = refusal.value.violations
    assert violation.limit == here.limits.q_upper[0]
    assert "shoulder_pan_joint at 2.50 rad/s at the release would have to come to a stop there" in violation.detail
    assert "collide" not in violation.detail


def test_a_release_with_just_enough_room_is_planned() -> None:
    here = cell()
    q, qd = here.home.copy(), np.zeros(6)
    q[4], qd[4] = -2.93, -1.8
    found = plan(ThrowProblem(here, here.home, JointRelease(q, qd), here.limits, time_limit_s=60.0))
    assert found.certificate.valid
