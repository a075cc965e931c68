"""Candidate release states: the seed of every back end.

`joint` has one. `pose` has one a branch and turn of the inverse kinematics. `point` adds orientations of the tool, and
`target` adds places and flights: both are drawn from a fixed quasi-random sequence, so the same request has the same
candidates. All are sorted by the time no launch can beat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import Infeasible, Violation
from planner.geometry import SELF_CLEARANCE_M, barriers, body_model
from planner.kinematics import (
    SINGULARITIES,
    inverse,
    inverse_velocity,
    jacobian,
    signed_singularity_distances,
    singularity_distances,
)
from planner.problem import JointRelease, PointRelease, PoseRelease, ThrowProblem
from planner.rotations import invert_pose
from planner.seeds.lower_bound import least_time
from planner.seeds.sampling import point_states, target_states

Vector = NDArray[np.float64]

SPEED_SLACK = 1e-9  # [-] rounding allowed in the comparison with a speed limit
# States looked at in turn, and with how many candidates no longer: a pose has hundreds of states, most turns away.
PORTIONS = ((slice(0, 24), 1), (slice(24, 48), 14), (slice(48, None), 1))
POSITION_SLACK = 1e-9  # [rad] likewise with a position limit


@dataclass(frozen=True, eq=False)
class Candidate:
    """A joint state to release in.

    Attributes:
        q: positions (6,) [rad].
        qd: velocities (6,) [rad/s].
        bound_s: no launch from the problem's start is shorter [s].
        label: how it was found, for the plan's story.
    """

    q: Vector
    qd: Vector
    bound_s: float
    label: str


def candidates(problem: ThrowProblem) -> list[Candidate]:
    """Returns the release states that respect the limits by themselves, soonest possible first.

    Raises:
        Infeasible: there is none; the violations say what stands in the way.
    """
    release = problem.release
    if isinstance(release, JointRelease):
        q, qd = release.q[None], release.qd[None]
        _refuse_joint_state(problem, release)
    elif isinstance(release, PoseRelease):
        q, qd = _pose_states(problem, release)
    elif isinstance(release, PointRelease):
        q, qd = point_states(problem, release)
    else:
        q, qd = target_states(problem, release)
    return _usable(problem, q, qd)


def _usable(problem: ThrowProblem, q: Vector, qd: Vector) -> list[Candidate]:
    """Returns the states that break no bound by themselves, soonest first.

    Raises:
        Infeasible: none is left; the violations are those of the state that comes nearest.
    """
    limits = problem.limits
    if len(q) == 0:
        raise Infeasible([Violation("joint_position", 1.0, 1.0, "1", detail="no posture was found")])
    excess = np.max(np.abs(qd) / limits.qd_max, axis=-1)
    distance = singularity_distances(problem.cell.robot, q).minimum
    singular = (distance < limits.singularity_distance_min) & (not problem.ends_at_rest)
    good = (excess <= 1.0 + SPEED_SLACK) & ~singular
    if not good.any():
        raise Infeasible(_reasons(problem, q, qd, excess, distance))
    near, far = problem.reachable.q_lower, problem.reachable.q_upper
    shut_off = np.any((q < near - POSITION_SLACK) | (q > far + POSITION_SLACK), axis=1)
    if shut_off[good].all():
        raise Infeasible([_barred(problem, q[good][0])])
    good &= ~shut_off
    q, qd = q[good], qd[good]
    bound = least_time(q - problem.start, qd, limits)
    order = np.lexsort([*q.T[::-1], bound])
    return _clear(problem, q[order], qd[order], bound[order])


def _clear(problem: ThrowProblem, q: Vector, qd: Vector, bound: Vector) -> list[Candidate]:
    """Returns the sorted states in which the arm may stand; those of later portions only if need be."""
    kind, good, least = problem.release.__class__.__name__, [], []
    for rows, enough in PORTIONS:
        if len(good) >= enough or rows.start >= len(q):
            break
        free = body_model(problem.cell).clearances(q[rows])
        good += (np.flatnonzero(free.least >= 0.0) + rows.start).tolist()
        least.append(free)
    if good:
        return [Candidate(q[i], qd[i], float(bound[i]), f"{kind} {i}") for i in good]
    best = max(least, key=lambda free: float(free.least.max()))
    raise Infeasible(best.violations(int(best.least.argmax()), problem.cell))


def _barred(problem: ThrowProblem, q: Vector) -> Violation:
    """Returns the self-collision that lies between the start and the state (6,), whichever way the arm goes."""
    cell, names = problem.cell, problem.cell.robot.joint_names
    low, high = np.minimum(problem.start, q), np.maximum(problem.start, q)
    for barrier in barriers(cell.robot, cell.tool.capsules):
        i = barrier.joint
        between = barrier.q[(barrier.q > low[i]) & (barrier.q < high[i])]
        if len(between):
            first = between[np.abs(between - problem.start[i]).argmin()]
            detail = f"{', '.join(barrier.names)}: on every way from the start, {names[i]} at {first:.2f} rad"
            return Violation("self_collision", barrier.distance_m, SELF_CLEARANCE_M, "m", detail=detail)
    raise AssertionError("no barrier lies between")


def _reasons(problem: ThrowProblem, q: Vector, qd: Vector, excess: Vector, distance: Vector) -> list[Violation]:
    """Returns what stands in the way of the state that comes nearest."""
    limits, names = problem.limits, problem.cell.robot.joint_names
    usable = distance >= limits.singularity_distance_min
    if problem.ends_at_rest or usable.any():
        rows = np.flatnonzero(usable) if usable.any() else np.arange(len(q))
        best = int(rows[excess[rows].argmin()])
        joint = int((np.abs(qd[best]) / limits.qd_max).argmax())
        speed, limit = float(abs(qd[best, joint])), float(limits.qd_max[joint])
        return [Violation("joint_velocity", speed, limit, "rad/s", detail=f"{names[joint]} at the release")]
    best = int(distance.argmax())
    distances = np.abs(signed_singularity_distances(problem.cell.robot, q[best]))
    name, value = SINGULARITIES[int(distances.argmin())], distances.min()
    return [
        Violation(
            "singularity_distance",
            float(value),
            limits.singularity_distance_min,
            "1",
            detail=f"{name} singularity at the release",
        )
    ]


def _refuse_joint_state(problem: ThrowProblem, release: JointRelease) -> None:
    limits, names = problem.limits, problem.cell.robot.joint_names
    violations = []
    for i in range(6):
        q = float(release.q[i])
        bound = float(limits.q_lower[i] if q < limits.q_lower[i] else limits.q_upper[i])
        if not limits.q_lower[i] - POSITION_SLACK <= q <= limits.q_upper[i] + POSITION_SLACK:
            violations.append(Violation("joint_position", q, bound, "rad", detail=f"{names[i]} at the release"))
    if violations:
        raise Infeasible(violations)


def _pose_states(problem: ThrowProblem, release: PoseRelease) -> tuple[Vector, Vector]:
    """Returns joint states (n, 6) of every branch and turn that reach pose and twist.

    Raises:
        Infeasible: out of reach, or no branch inside the joint limits.
    """
    cell, limits = problem.cell, problem.limits
    X_BT = invert_pose(cell.X_WB) @ release.X_WT
    found = inverse(cell.robot, X_BT, cell.tool.X_FT, limits.q_lower, limits.q_upper)
    if found.reach_excess_m > 0.0:
        raise Infeasible([reach_violation(found.reach_excess_m, problem, release.X_WT[:3, 3])])
    if len(found.q) == 0:
        raise Infeasible([_nearest_joint_limit(problem, X_BT)])
    R_BW = cell.X_WB[:3, :3].T
    V_BT = np.concatenate([R_BW @ release.V_WT[:3], R_BW @ release.V_WT[3:]])
    distance = singularity_distances(cell.robot, found.q).minimum
    usable = distance > 1e-6
    if not usable.any():
        qd = np.zeros_like(found.q)
        return found.q, qd
    q = found.q[usable]
    return q, inverse_velocity(jacobian(cell.robot, q, cell.tool.X_FT), V_BT)


def reach_violation(excess_m: float, problem: ThrowProblem, p_W: Vector) -> Violation:
    """Returns the violation of a place `excess_m` beyond what the arm reaches."""
    p_B = problem.cell.X_WB[:3, :3].T @ (p_W - problem.cell.X_WB[:3, 3])
    away = float(np.linalg.norm(p_B))
    return Violation("reach", away, away - excess_m, "m", detail="distance from the arm's base")


def _nearest_joint_limit(problem: ThrowProblem, X_BT: Vector) -> Violation:
    """Returns by how much the most lenient branch misses the joint limits."""
    cell, limits = problem.cell, problem.limits
    robot = cell.robot
    anywhere = inverse(robot, X_BT, cell.tool.X_FT, robot.q_lower, robot.q_upper).q
    if len(anywhere) == 0:
        return Violation("joint_position", 1.0, 1.0, "1", detail="no posture within the arm's joint limits reaches it")
    over = np.maximum(limits.q_lower - anywhere, anywhere - limits.q_upper)
    best = int(over.max(axis=1).argmin())
    joint = int(over[best].argmax())
    q = float(anywhere[best, joint])
    bound = float(limits.q_lower[joint] if q < limits.q_lower[joint] else limits.q_upper[joint])
    return Violation("joint_position", q, bound, "rad", detail=f"{robot.joint_names[joint]} at the release")
