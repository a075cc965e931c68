"""Every constraint is active in some problem: the answer without it breaks it, the answer with it lies at the limit.

"Without it" is the plan for wider limits; for floor and the arm itself, which cannot be switched off, it is Ruckig's
motion to the same release, which knows neither.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.cell import Box, shape_of
from planner.certificate import certify
from planner.planning import plan
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import candidates
from planner.trajectory import Trajectory
from tests.planner.problems import cell, ideal_cell, joint_problem

HOME = cell().home
FAR_M = 5.0
ROUNDING = 1e-6


@dataclass(frozen=True)
class Case:
    """A problem without the constraint, how the constraint is added for its answer, how close to the limit [unit]."""

    problem: ThrowProblem
    within: float
    add: Callable[[ThrowProblem, Trajectory], ThrowProblem]
    detail: str = ""


def target(x, y, **changes):
    return joint_problem(release=TargetRelease(np.array([x, y, 0.0])), **changes)


def limited(problem, **changes):
    return replace(problem, limits=replace(problem.limits, **changes))


def among(problem, **changes):
    return replace(problem, cell=replace(problem.cell, surroundings=replace(problem.cell.surroundings, **changes)))


def value(problem, motion, name):
    return certify(problem, motion).check(name).value


def slower_joints(problem, motion):
    at_release = np.abs(motion.qd[motion.release_index])
    return limited(problem, qd_max=np.maximum(0.85 * np.abs(motion.qd).max(axis=0), 1.02 * at_release))


def weaker_joint(problem, motion):
    check = certify(problem, motion).check("joint_torque")
    worst = np.array(problem.cell.robot.joint_names) == check.detail
    return limited(problem, tau_max=np.where(worst, 0.9 * check.value, problem.limits.tau_max))


def shorter_range(problem, motion):
    """The shoulder may swing back only half as far as it did."""
    lower = np.array(problem.limits.q_lower)
    lower[1] = (motion.q[0, 1] + motion.q[:, 1].min()) / 2.0
    return limited(problem, q_lower=lower)


def lower_ceiling(problem, motion):
    return among(problem, keep_in=(Box(np.full(3, -FAR_M), np.array([FAR_M, FAR_M, 0.9])),))


def sloping_ceiling(problem, motion):
    turn = rotation_vector_to_matrix(np.array([0.1, 0.15, 0.0]))
    middle = np.array([0.0, 0.0, 0.9]) - FAR_M * turn[:, 2]
    return among(problem, keep_in=(shape_of("box", pose(middle, turn), np.full(3, 2.0 * FAR_M), "attic"),))


def dome(problem, motion):
    return among(problem, keep_in=(shape_of("sphere", pose(np.zeros(3), np.eye(3)), np.array([1.0, 0.0]), "dome"),))


def box_above(problem, motion):
    return among(problem, keep_out=(Box(np.array([-0.2, -0.4, 0.9]), np.array([0.2, 0.4, 1.2])),))


def away_from_singularities(problem, motion):
    least = value(problem, motion, "singularity_distance") + 0.1
    return limited(problem, singularity_distance_min=least)


def held_by(problem, **changes):
    return replace(problem, cell=replace(problem.cell, gripper=replace(problem.cell.gripper, **changes)))


def weaker_grip(problem, motion):
    return held_by(problem, hold_acceleration_m_s2=np.array([0.9 * value(problem, motion, "grip_acceleration")]))


def narrower_opening(problem, motion):
    return held_by(problem, opening_cone_rad=value(problem, motion, "opening_direction") - 0.2)


def wall_before_the_target(problem, motion):
    return among(problem, keep_out=(Box(np.array([0.9, -0.4, 0.0]), np.array([1.0, 0.8, 0.65])),))


def as_it_is(problem, motion):
    return problem


CASES = {
    "joint_position": Case(target(1.2, 0.4), 0.01, shorter_range),
    "joint_velocity": Case(joint_problem(), 0.02, slower_joints),
    "joint_acceleration": Case(
        target(1.3, 0.2), 0.05, lambda p, _: limited(p, qdd_max=0.6 * p.limits.qdd_max)
    ),
    "joint_jerk": Case(target(1.3, 0.2), 1.0, lambda p, _: limited(p, jerk_max=0.4 * p.limits.jerk_max)),
    "joint_torque": Case(target(1.3, 0.2), 4.0, weaker_joint),
    "tcp_speed": Case(
        target(1.3, 0.2), 0.1, lambda p, m: limited(p, tcp_speed_max=0.9 * value(p, m, "tcp_speed"))
    ),
    "floor": Case(
        joint_problem(
            release=JointRelease(
                np.array([0.48, -1.32, 1.99, -1.97, -1.17, -0.3]), np.array([-0.43, 0.45, -0.11, 1.48, -0.8, -0.98])
            )
        ),
        0.01,
        as_it_is,
    ),
    "self_collision": Case(
        joint_problem(
            cell=ideal_cell(),
            release=JointRelease(
                np.array([-0.73, -2.0, 2.54, -1.51, -2.49, 0.05]), np.array([-0.73, 1.38, 1.76, 0.15, 0.91, -0.53])
            )
        ),
        0.005,
        as_it_is,
    ),
    "keep_in": Case(target(1.3, 0.2), 0.01, lower_ceiling),
    "keep_in (turned)": Case(target(1.3, 0.2), 0.01, sloping_ceiling, "attic"),
    "keep_in (round)": Case(target(1.3, 0.2), 0.01, dome, "dome"),
    "keep_out": Case(target(0.8, -0.8), 0.01, box_above),
    "grip_acceleration": Case(target(1.3, 0.2), 2.0, weaker_grip),
    "opening_direction": Case(target(1.3, 0.2), 0.3, narrower_opening),
    "flight_clearance": Case(target(1.3, 0.2), 0.05, wall_before_the_target),
    "singularity_distance (shoulder)": Case(
        target(0.7, -0.8, start=HOME + np.array([0.0, -0.2, -1.0, 0.0, 0.0, 0.0])),
        0.03,
        away_from_singularities,
        "shoulder",
    ),
    "singularity_distance (elbow)": Case(
        target(-1.2, 0.3, start=HOME + np.array([0.0, 0.3, -1.2, 0.0, 0.0, 0.0])),
        0.03,
        away_from_singularities,
        "elbow",
    ),
    "singularity_distance (wrist)": Case(
        target(0.8, -0.8, start=HOME + np.array([0.0, 0.0, 0.0, 0.0, 1.3, 0.0])), 0.03, away_from_singularities, "wrist"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_constraint_is_active_and_respected(name):
    case = CASES[name]
    check_name = name.split(" (")[0]
    if case.add is as_it_is:
        free = ruckig_otg.solve(case.problem, candidates(case.problem)[0]).trajectory
    else:
        free = plan(case.problem).trajectory
    problem = case.add(case.problem, free)
    broken = certify(problem, free).check(check_name)
    assert not broken.ok
    kept = plan(problem).certificate
    assert kept.valid
    check = kept.check(check_name)
    assert -ROUNDING <= check.margin <= case.within
    assert case.detail in check.detail


def test_every_constraint_has_its_case():
    plain = joint_problem(backend="ruckig")
    boxed = lower_ceiling(box_above(plain, None), None)
    checked = {check.name for check in certify(boxed, plan(plain).trajectory).checks}
    of_the_request = {"start", "release_position", "release_velocity", "end_at_rest", "continuity"}
    # Not rows of the optimiser:
    certificate_alone = {"elbow_speed", "momentum", "power", "stopping_time", "stopping_distance"}
    assert {name.split(" (")[0] for name in CASES} == checked - of_the_request - certificate_alone
