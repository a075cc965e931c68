"""Release states for releases that leave something free, drawn from a fixed quasi-random sequence.

A `point` leaves the tool's orientation and turning free; a `target` leaves place, direction and speed free too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.cell import Limits
from planner.errors import Infeasible, Violation
from planner.flight import launch_velocity, least_speed
from planner.kinematics import forward, inverse_branches, jacobian, singularity_distances
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import invert_pose, quaternion_to_matrix
from planner.seeds.lower_bound import least_time
from planner.seeds.quasi_random import offsets, quaternions
from planner.seeds.velocity_allocation import spread_velocity

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

ORIENTATIONS = 96  # of the tool tried at a point
MORE_ORIENTATIONS, FEW_POSTURES = 1024, 24  # tried where the first lead to so few postures: narrow joint limits
PLACES = 1024  # joint states tried for a target
KEPT = 48  # of them, the soonest, kept apart from one another
APART_RAD = 0.35  # two kept states differ by this in some joint
PORTION = 64  # states compared with one another at once
TOO_FAST_S = 1e3  # [s] for a joint at its largest speed: every state that is too fast comes after all others
FLIGHT_STRETCH = (1.0, 0.8, 1.25, 0.6)  # flight times tried, as shares of the slowest throw's


def point_states(problem: ThrowProblem, release: PointRelease) -> tuple[Vector, Vector]:
    """Returns joint states (n, 6) at the point with its velocity, for orientations all round.

    Raises:
        Infeasible: no orientation brings the tool there.
    """
    q = _postures(problem, release.p_WT)
    qd = spread_velocity(tool_jacobian(problem, q), problem.cell.X_WB[:3, :3].T @ release.v_WT, problem.limits.qd_max)
    rows = _soonest(problem, q, qd)
    return q[rows], qd[rows]


def _postures(problem: ThrowProblem, p_WT: Vector) -> Vector:
    """Returns joint positions (n, 6) that bring the tool to a place, in orientations all round.

    Raises:
        Infeasible: there are none.
    """
    for orientations in (ORIENTATIONS, MORE_ORIENTATIONS):
        q = _postures_in(problem, p_WT, orientations)
        if len(q) >= FEW_POSTURES:
            break
    if len(q) == 0:
        raise Infeasible([_unreachable(problem, p_WT)])
    return q


def _postures_in(problem: ThrowProblem, p_WT: Vector, orientations: int) -> Vector:
    X_WT = np.tile(np.eye(4), (orientations, 1, 1))
    X_WT[:, :3, :3] = quaternion_to_matrix(quaternions(orientations))
    X_WT[:, :3, 3] = p_WT
    cell = problem.cell
    branches, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    q = _within(problem, branches)
    return q[singularity_distances(cell.robot, q).minimum >= problem.limits.singularity_distance_min]


def target_states(problem: ThrowProblem, release: TargetRelease) -> tuple[Vector, Vector]:
    """Returns joint states (n, 6) from which free flight hits the target within the bounds asked for.

    Raises:
        Infeasible: no state was found whose flight hits.
    """
    if release.release_position is not None:
        q = _postures(problem, release.release_position)
        return _flights(problem, release, q, np.broadcast_to(release.release_position, (len(q), 3)))
    limits = problem.reachable
    centre = np.clip(problem.start, limits.q_lower, limits.q_upper)
    q = np.clip(centre + offsets(PLACES), limits.q_lower, limits.q_upper)
    cell = problem.cell
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    away = np.linalg.norm((p - release.p_W)[:, :2], axis=1)
    allowed = (away >= release.min_horizontal_distance_m) & _inside(problem, p)
    allowed &= singularity_distances(cell.robot, q).minimum >= limits.singularity_distance_min
    q, p = q[allowed], p[allowed]
    return _flights(problem, release, q, p)


def _flights(problem: ThrowProblem, release: TargetRelease, q: Vector, p: Vector) -> tuple[Vector, Vector]:
    """Returns for postures q (n, 6) at places p (n, 3) those joint states whose flights obey the bounds.

    Raises:
        Infeasible: there are none.
    """
    slowest = np.sqrt(2.0 * np.linalg.norm(release.p_W - p, axis=1) / problem.gravity)
    t = np.outer(FLIGHT_STRETCH, slowest)
    v = launch_velocity(p, release.p_W, t, problem.gravity)
    ok = _allowed_velocity(release, v) & (v[..., 2] < problem.gravity * t)
    if not ok.any():
        raise Infeasible([_no_flight(problem, release, p)])
    J, R_BW = tool_jacobian(problem, q), problem.cell.X_WB[:3, :3].T
    qd = spread_velocity(J, v @ R_BW.T, problem.limits.qd_max, ok)
    stretch = _best_of_place(problem, q, qd, ok)
    flown = np.flatnonzero(ok.any(axis=0))
    qd = qd[stretch[flown], flown]
    rows = _soonest(problem, q[flown], qd)
    kept, qd = flown[rows], qd[rows]
    if problem.drag <= 0.0:
        return q[kept], qd
    v = launch_velocity(p[kept], release.p_W, t[stretch[kept], kept], problem.gravity, problem.drag)
    hits = np.isfinite(v).all(axis=1) & _allowed_velocity(release, v)
    kept, v = kept[hits], v[hits]
    return q[kept], spread_velocity(J[kept], v @ R_BW.T, problem.limits.qd_max)


def _best_of_place(problem: ThrowProblem, q: Vector, qd: Vector, ok: Mask) -> NDArray[np.intp]:
    """Returns which of the flights qd (k, n, 6) of every posture q (n, 6) is soonest, or least too fast."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=-1)
    bound = least_time(q - problem.start, qd, problem.limits)
    penalty = np.where(excess <= 1.0, bound, TOO_FAST_S * excess)
    return np.where(ok, penalty, np.inf).argmin(axis=0)


def tool_jacobian(problem: ThrowProblem, q: Vector) -> Vector:
    """Returns the tool's linear Jacobian in the base (n, 3, 6) [m/rad]."""
    return jacobian(problem.cell.robot, q, problem.cell.tool.X_FT)[:, :3, :]


def _allowed_velocity(release: TargetRelease, v: Vector) -> Mask:
    speed = np.linalg.norm(v, axis=-1)
    elevation = np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))
    return (
        (speed <= release.max_speed_m_s)
        & (elevation >= release.min_elevation_rad)
        & (elevation <= release.max_elevation_rad)
    )


def _soonest(problem: ThrowProblem, q: Vector, qd: Vector) -> NDArray[np.intp]:
    """Returns the rows of the KEPT states of least bound that differ from one another; of too fast ones if all are."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=1)
    usable = np.flatnonzero(excess <= 1.0)
    if len(usable) == 0:
        return np.argsort(excess, kind="stable")[:KEPT]
    bound = least_time(q[usable] - problem.start, qd[usable], problem.limits)
    order = usable[np.argsort(bound, kind="stable")]
    return order[_apart(q[order])]


def _apart(q: Vector) -> NDArray[np.intp]:
    """Returns the first KEPT of the rows of `q` (n, 6) that differ from all rows kept before them.

    In portions: where one posture is like the next, hundreds are looked at for a few dozen.
    """
    kept: list[int] = []
    for begin in range(0, len(q), PORTION):
        here = q[begin : begin + PORTION]
        free = np.asarray(_differ(here, q[kept]).all(axis=1))
        apart = _differ(here, here)
        for i in range(len(here)):
            if free[i]:
                kept.append(begin + i)
                free &= apart[i]
        if len(kept) >= KEPT:
            break
    return np.array(kept[:KEPT], dtype=np.intp)


def _differ(a: Vector, b: Vector) -> Mask:
    """Returns whether rows of a (n, 6) and b (m, 6) differ (n, m)."""
    return np.asarray((np.abs(a[:, None] - b) > APART_RAD).any(axis=2))


def _within(problem: ThrowProblem, q: Vector) -> Vector:
    """Returns those of the inverse kinematics' branches (m, 8, 6), in every turn, that lie within the limits (n, 6)."""
    q = q.reshape(-1, 6)
    q = q[np.isfinite(q).all(axis=1)]
    return _turned_into(problem.reachable, problem.start, q)


def _turned_into(limits: Limits, start: Vector, q: Vector) -> Vector:
    """Returns `q` (n, 6) with every joint turned by whole turns next to `start`, those within the limits only."""
    turn = 2.0 * np.pi
    q = q + turn * np.round((start - q) / turn)
    q = np.where(q > limits.q_upper, q - turn, q)
    q = np.where(q < limits.q_lower, q + turn, q)
    return q[np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1)]


def _inside(problem: ThrowProblem, p: Vector) -> Mask:
    around = problem.cell.surroundings
    ok = p[:, 2] > around.floor_z_m + around.clearance_m + problem.cell.object.radius_m
    for box in around.keep_in:
        ok &= np.all((p >= box.lower) & (p <= box.upper), axis=1)
    for box in around.keep_out:
        ok &= ~np.all((p >= box.lower) & (p <= box.upper), axis=1)
    return ok


def _unreachable(problem: ThrowProblem, p_W: Vector) -> Violation:
    cell = problem.cell
    p_B = cell.X_WB[:3, :3].T @ (p_W - cell.X_WB[:3, 3])
    away, reach = float(np.linalg.norm(p_B)), farthest_reach(problem)
    if away > reach:
        return Violation("reach", away, reach, "m", detail="distance from the arm's base")
    return Violation(
        "joint_position", away, reach, "m", detail="no posture within the joint limits brings the tool there"
    )


def farthest_reach(problem: ThrowProblem) -> float:
    """Returns how far from the base no point of the tool can be [m]: the sum of all link lengths and the tool's."""
    robot = problem.cell.robot
    return float(np.hypot(robot.a, robot.d).sum() + np.linalg.norm(problem.cell.tool.X_FT[:3, 3]))


def _no_flight(problem: ThrowProblem, release: TargetRelease, p: Vector) -> Violation:
    if len(p) == 0:
        return Violation(
            "release_position",
            0.0,
            release.min_horizontal_distance_m,
            "m",
            detail="no release place obeys keep-in boxes, floor and distance to the target",
        )
    speed = float(least_speed(p, release.p_W, problem.gravity).min())
    return Violation(
        "release_velocity",
        speed,
        release.max_speed_m_s,
        "m/s",
        detail="least speed that hits the target within the elevations asked for",
    )
