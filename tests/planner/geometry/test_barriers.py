"""Joint positions shut off by self-collision: against brute force, and as a planner's user meets them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Cell, ToolCapsule
from planner.errors import Infeasible
from planner.geometry import SELF_CLEARANCE_M, barriers, body_capsules, passable
from planner.kinematics import link_poses
from planner.planning import plan
from planner.problem import JointRelease, PointRelease, TargetRelease, ThrowProblem
from planner.robots import robot
from planner.seeds import candidates
from tests.planner.problems import cell, pose_problem

TOOL = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.05),)
POINTS = np.linspace(0.0, 1.0, 61)[:, None]
BEYOND = 1e-3  # [rad] from an edge; distances by brute force are a hundredth of a millimetre too large there
THICK = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.06),)
GRAZING = np.array([-0.48, -2.862, 1.801, -0.174, -2.6, -0.231])  # wrist_2 next to its barrier at -2.68 rad


def brute_distance(name: str, names: tuple[str, str], q: np.ndarray) -> float:
    """Surface distance of two bodies from points all along both axes."""
    bodies = {c.name: c for c in body_capsules(robot(name), TOOL)}
    poses = link_poses(robot(name), q)
    one, other = (bodies[n] for n in names)
    lines = []
    for body in (one, other):
        X = poses[body.frame]
        lines.append((body.p0 + POINTS * (body.p1 - body.p0)) @ X[:3, :3].T + X[:3, 3])
    gap = np.linalg.norm(lines[0][:, None] - lines[1][None], axis=2).min()
    return float(gap) - one.radius_m - other.radius_m


@pytest.mark.parametrize("name", ["ur3e", "ur5e", "ur5"])
def test_whatever_the_other_joints_do_two_bodies_are_too_near_there_and_not_just_beyond(name: str) -> None:
    rng = np.random.default_rng(3)
    found = barriers(robot(name), TOOL)
    assert found
    for barrier in found:
        edge = barrier.q[barrier.q > 0.0].min()
        for _ in range(5):
            q = rng.uniform(-np.pi, np.pi, 6)
            q[barrier.joint] = rng.choice(barrier.q)
            assert brute_distance(name, barrier.names, q) < SELF_CLEARANCE_M + 1e-4
            q[barrier.joint] = edge - BEYOND
            assert brute_distance(name, barrier.names, q) > SELF_CLEARANCE_M


def test_a_start_beside_a_barrier_is_shut_off_by_it_and_one_within_is_not() -> None:
    q = cell().home.copy()
    edge = passable(robot("ur5e"), THICK, q)[0][4]
    for offset, bound in ((1e-4, edge), (-1e-4, -np.inf), (-0.05, -np.inf)):
        q[4] = edge + offset
        assert passable(robot("ur5e"), THICK, q)[0][4] == bound


def test_the_wrist_of_a_ur5e_cannot_fold_a_tool_back_through_itself() -> None:
    home = cell().home
    lower, upper = passable(robot("ur5e"), THICK, home)
    assert -np.pi < lower[4] < -2.6
    assert 2.6 < upper[4] < np.pi
    assert np.isinf(lower[[0, 3, 5]]).all()


def test_a_tool_to_one_side_turns_about_its_axis_and_bars_nothing() -> None:
    aside = (ToolCapsule(np.array([0.05, 0.0, 0.0]), np.array([0.05, 0.0, 0.15]), 0.06),)
    assert not [b for b in barriers(robot("ur5e"), aside) if b.joint == 4]


def test_a_blocked_start_takes_every_position_for_passable() -> None:
    q = cell().home.copy()
    q[4] = -np.pi
    assert np.isinf(passable(robot("ur5e"), THICK, q)[0][4])


def thick_tool() -> Cell:
    return replace(cell(), tool=replace(cell().tool, capsules=THICK))


def test_a_state_beyond_a_barrier_is_refused_by_name() -> None:
    here = thick_tool()
    q = here.home.copy()
    q[4] = -4.0
    problem = ThrowProblem(here, here.home, JointRelease(q, np.full(6, 0.3)), here.limits)
    with pytest.raises(Infeasible) as refusal:
        candidates(problem)
    (violation,) = refusal.value.violations
    assert violation.constraint == "self_collision"
    assert violation.value < violation.limit == SELF_CLEARANCE_M
    assert "wrist_1, tool_0" in violation.detail
    assert "wrist_2_joint passes -2." in violation.detail


def test_no_candidate_lies_beyond_a_barrier() -> None:
    here = thick_tool()
    pose = pose_problem(here, here.home + 0.2, np.full(6, 0.2))
    point = ThrowProblem(here, GRAZING, PointRelease(np.array([-0.628, -0.5, 0.196]), np.ones(3) * 0.4), here.limits)
    target = ThrowProblem(here, GRAZING, TargetRelease(np.array([1.2, 0.4, 0.0])), here.limits)
    for problem in (replace(pose, start=GRAZING), point, target):
        q = np.array([candidate.q for candidate in candidates(problem)])
        assert (q[:, 4] > -np.pi).all()


def test_a_start_next_to_a_barrier_is_planned_from() -> None:
    here = thick_tool()
    release = PointRelease(np.array([-0.628, -0.5, 0.196]), np.array([0.603, -0.392, 0.637]))
    found = plan(ThrowProblem(here, GRAZING, release, here.limits, time_limit_s=60.0))
    assert found.certificate.valid
    assert found.backend == "casadi"
