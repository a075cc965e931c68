"""The room that joints need to reach a velocity and to lose it: against Ruckig's motions, and as a user meets it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import ruckig

from planner.errors import Infeasible
from planner.geometry import tool_pose
from planner.kinematics import jacobian
from planner.planning import plan
from planner.problem import JointRelease, PoseRelease, ThrowProblem
from planner.seeds import candidates
from planner.seeds.turning_room import lack_of_room
from tests.planner.problems import cell


def in_world(here):
    """Returns the rotation (6, 6) of a twist from the base to the world."""
    R = here.X_WB[:3, :3]
    whole = np.zeros((6, 6))
    whole[:3, :3] = whole[3:, 3:] = R
    return whole


def turned(start: float, q: float, v: float, acceleration: float, jerk: float) -> tuple[float, float]:
    """Returns the least and the largest position [rad] of Ruckig's soonest motion of one joint from rest to q, v."""
    asked = ruckig.InputParameter(1)
    asked.current_position = [start]
    asked.current_velocity = [0.0]
    asked.current_acceleration = [0.0]
    asked.target_position = [q]
    asked.target_velocity = [v]
    asked.target_acceleration = [0.0]
    asked.max_velocity = [abs(v) + 1.0]
    asked.max_acceleration = [acceleration]
    asked.max_jerk = [jerk]
    found = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(asked, found) == ruckig.Result.Working
    positions = [found.at_time(t)[0][0] for t in np.linspace(0.0, found.duration, 2001)]  # not its extrema
    return min(positions), max(positions)


def test_no_motion_of_ruckig_needs_less_room_and_some_hardly_more() -> None:
    here = cell()
    rng = np.random.default_rng(1)
    spare = []
    limits = replace(here.limits, qdd_max=np.full(6, 15.0), jerk_max=np.full(6, 1e6))
    for _ in range(200):
        q = rng.uniform(-1.0, 1.0)
        v = rng.uniform(-3.0, 3.0)
        least, most = turned(rng.uniform(-1.0, 1.0), q, v, 15.0, 1e6)
        bounded = replace(limits, q_lower=np.full(6, least))
        bounded = bounded if v > 0.0 else replace(limits, q_upper=np.full(6, most))
        problem = ThrowProblem(here, np.clip(np.zeros(6), bounded.q_lower, bounded.q_upper), joint(q, v), bounded)
        lack = lack_of_room(problem, np.full((1, 6), q), np.full((1, 6), v))[0, 0]
        assert lack <= 1e-5  # between two samples
        spare.append(-lack)
    assert min(spare) < 1e-3


def joint(q: float, v: float) -> JointRelease:
    return JointRelease(np.full(6, q), np.full(6, v))


@pytest.mark.parametrize(("speed", "what"), [(2.4, "get up to speed"), (-2.4, "stop")])
def test_a_release_too_close_to_a_barrier_is_refused_with_proof_and_offers_a_slower_one(
    speed: float, what: str
) -> None:
    here = cell()
    q = here.home.copy()
    qd = np.zeros(6)
    q[4] = -2.93
    qd[4] = speed
    problem = ThrowProblem(here, here.home, JointRelease(q, qd), here.limits)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    (violation,) = refusal.value.violations
    assert violation.constraint == "joint_velocity"
    assert violation.proven
    assert violation.value == 2.4
    room = -2.93 - problem.reachable.q_lower[4]
    assert violation.limit == pytest.approx(np.sqrt(2.0 * here.limits.qdd_max[4] * room))
    assert f"wrist_2_joint at the release: it has {room:.3f} rad to {what}" in violation.detail
    assert "where wrist_1 and tool_0 collide" in violation.detail
    (attempt,) = refusal.value.attempts
    assert attempt["result"] == "the release state: none with room to get up to speed and to stop"
    nearest = refusal.value.nearest
    assert nearest is not None
    assert nearest["release"]["positions"] == pytest.approx(q)
    assert 0.5 * violation.limit < abs(nearest["release"]["velocities"][4]) < violation.limit


def test_a_release_too_close_to_a_joint_limit_is_refused_by_that_limit() -> None:
    here = cell()
    q = here.home.copy()
    qd = np.zeros(6)
    q[0] = 6.2
    qd[0] = 2.5
    with pytest.raises(Infeasible) as refusal:
        candidates(ThrowProblem(here, here.home, JointRelease(q, qd), here.limits))
    (violation,) = refusal.value.violations
    assert violation.limit == pytest.approx(np.sqrt(2.0 * here.limits.qdd_max[0] * (here.limits.q_upper[0] - 6.2)))
    assert "shoulder_pan_joint at the release: it has 0.083 rad to stop, to its position limit" in violation.detail


def test_a_slow_joint_that_may_be_released_a_little_slower_is_not_refused() -> None:
    here = cell()
    q = cell().home.copy()
    qd = np.zeros(6)
    qd[0] = 0.3
    limits = replace(here.limits, qdd_max=np.full(6, 0.01))
    stands = q[0] + (0.3 - 1e-4) ** 2 / 0.02  # as slow as the certificate takes it
    limits = replace(limits, q_upper=np.array([stands + 1e-9, *here.limits.q_upper[1:]]))
    problem = ThrowProblem(here, here.home, JointRelease(q, qd), limits)
    assert lack_of_room(problem, q[None], qd[None]).max() < 0.0
    shorter = replace(limits, q_upper=limits.q_upper - np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert lack_of_room(replace(problem, limits=shorter), q[None], qd[None]).max() > 0.0


def test_a_pose_beside_a_singularity_is_not_refused_for_what_its_tolerance_allows() -> None:
    here = cell()
    q = np.array([-2.5007176, -0.9623984, -0.8191616, -3.3092865, 0.0631021, -1.0142057])
    qd = np.array([0.064, 0.010, 0.025, 2.9, -0.069, 0.030])
    X = tool_pose(here, q)
    J = in_world(here) @ jacobian(here.robot, q, here.tool.X_FT)
    problem = ThrowProblem(here, here.home, PoseRelease(X, J @ qd), here.limits)
    turned = qd**2 / 2.0 / here.limits.qdd_max
    error = np.linalg.inv(J) @ (1e-4 * np.sign(np.linalg.inv(J)[3]))  # of the velocity, the largest of joint 4
    slower = (qd - error)[3] ** 2 / 2.0 / here.limits.qdd_max[3]
    assert turned[3] - slower > 5e-3
    upper = here.limits.q_upper.copy()
    upper[3] = q[3] + slower
    limits = replace(here.limits, q_upper=upper)
    assert lack_of_room(replace(problem, limits=limits, start=q), q[None], qd[None])[0, 3] < 0.0


def test_a_release_with_just_enough_room_is_planned() -> None:
    here = cell()
    q = here.home.copy()
    qd = np.zeros(6)
    q[4] = -2.865  # 0.134 rad before wrist_1 and tool_0 collide
    qd[4] = -1.8
    found = plan(ThrowProblem(here, here.home, JointRelease(q, qd), here.limits, time_limit_s=60.0))
    assert found.certificate.valid
