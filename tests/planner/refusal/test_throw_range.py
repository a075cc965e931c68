"""Bounds on the arm's reach and on its speed away from the shoulder hold for random states, and rule targets out."""

from dataclasses import replace

import numpy as np
import pytest

from planner.errors import Infeasible
from planner.flight import fly
from planner.geometry import tool_pose
from planner.kinematics import jacobian
from planner.planning import plan
from planner.problem import TargetRelease
from planner.refusal.throw_range import (
    _radial_bound,
    farthest_reach_from_shoulder,
    out_of_range,
    shoulder_position,
)
from tests.planner.problems import cell, joint_problem

ARMS = ("ur3e-sim", "ur5-sim", "ur5e-sim", "ur10e-sim")
STATES = 20_000


def states(here, seed=0):
    """Random postures, half of them nearly stretched, with the tool's place from the shoulder and its Jacobian."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (STATES, 6))
    q[::2, 2:4] *= 0.1
    p = tool_pose(here, q)[:, :3, 3] - shoulder_position(here)
    return q, p, here.X_WB[:3, :3] @ jacobian(here.robot, q, here.tool.X_FT)[:, :3]


@pytest.mark.parametrize("arm", ARMS)
def test_no_state_exceeds_the_bounds(arm):
    here = cell(arm)
    _, p, J = states(here)
    away = np.linalg.norm(p, axis=1)
    reach = farthest_reach_from_shoulder(here)
    assert away.max() <= reach
    assert away.max() > 0.98 * reach
    speed = np.abs(np.einsum("ni,nij->nj", p / away[:, None], J)) @ here.limits.qd_max
    bound = _radial_bound(here, here.limits.qd_max[2:5].tobytes()).most(away)
    assert np.all(speed <= bound)
    assert np.median(bound / np.maximum(speed, 1e-3)) < 3.0


@pytest.mark.parametrize("arm", ARMS)
def test_no_target_of_a_possible_throw_is_ruled_out(arm):
    here = cell(arm)
    rng = np.random.default_rng(1)
    _, p, J = states(here, seed=1)
    outward = np.sign(np.einsum("ni,nij->nj", p, J)) * here.limits.qd_max * rng.uniform(0.5, 1.0, (STATES, 6))
    v = np.einsum("nij,nj->ni", J, outward)
    v *= np.minimum(1.0, here.limits.tcp_speed_max / np.linalg.norm(v, axis=1))[:, None]
    flights = [fly(p[i] + shoulder_position(here), v[i], 0.0, 9.81) for i in range(0, STATES, 20)]
    landed = np.array([flight.landing_point for flight in flights if flight is not None])
    farthest = landed[np.argsort(-np.linalg.norm(landed[:, :2], axis=1))[:40]]
    for target in farthest:
        problem = joint_problem(arm, release=TargetRelease(target))
        assert out_of_range(problem, problem.release) is None


@pytest.mark.parametrize("arm", ["ur3e-sim", "ur5e-sim"])
def test_a_target_beyond_the_stretched_arm_is_refused_with_proof(arm):
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(arm, release=TargetRelease(np.array([3.0 if arm == "ur5e-sim" else 2.6, 0.0, 0.0]))))
    (violation,) = refusal.value.violations
    assert violation.proven
    assert violation.constraint == "joint_velocity"
    assert violation.value > violation.limit
    assert refusal.value.nearest is not None


def test_what_the_bounds_do_not_cover_is_left_to_the_search():
    problem = joint_problem(release=TargetRelease(np.array([3.0, 0.0, 0.0])))
    assert out_of_range(problem, problem.release) is not None
    here = problem.cell
    with_drag = replace(here, object=replace(here.object, drag_coefficient=0.47))
    X_FT = here.tool.X_FT.copy()
    X_FT[0, 3] = 0.1
    beside = replace(here, tool=replace(here.tool, X_FT=X_FT))
    for other in (with_drag, beside):
        changed = replace(problem, cell=other)
        assert out_of_range(changed, changed.release) is None


def test_more_is_lacking_farther_out_and_with_slower_joints():
    here = cell()
    direction = np.array([2.11, -0.82, 0.53])

    def lacking(scale, speed):
        release = TargetRelease(scale * direction)
        slow = replace(here.limits, qd_max=np.full(6, speed))
        return out_of_range(joint_problem(cell=here, release=release, limits=slow), release).lacking()

    by_distance = [lacking(scale, 3.0) for scale in (1.0, 1.03, 1.06)]
    assert by_distance[0] > 0.1  # [m/s] well beyond what the rounding of the search would be
    assert by_distance == sorted(by_distance)
    by_speed = [lacking(1.0, speed) for speed in (3.0, 2.5, 2.0)]
    assert by_speed == sorted(by_speed)
