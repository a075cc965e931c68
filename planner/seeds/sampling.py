"""Joint states for releases that leave something free, drawn from a fixed quasi-random sequence, soonest first.

A `point` leaves the tool's orientation and angular velocity free; a `target` leaves the release position, the direction
and the speed free, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from planner.arrays import Array, Index, Mask, read_only
from planner.cell import Limits
from planner.errors import Infeasible, Violation
from planner.flight import launch_velocity, least_speed, slowest_time
from planner.geometry import body_model, tool_pose
from planner.kinematics import inverse_branches, jacobian, singularity_distances
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import invert_pose, quaternion_to_matrix
from planner.seeds.velocity_allocation import allocate_velocity

ORIENTATIONS = 96  # tool orientations tried at a point
MORE_ORIENTATIONS, FEW_POSTURES = 1024, 24  # tried instead where those give fewer postures: narrow joint limits
POSTURES = 512  # joint states tried for a target
# [-] of `SPREAD_RAD`: distances from the soonest states at which sooner ones are looked for, in turn. Six dimensions
# are too many to fill: this brings a target's least lower bound down by a third, twice as many postures by a tenth.
NEARBY_SHARES = (0.4, 0.2, 0.1)
MOVED, NEARBY = 12, 12  # soonest states that this is done for, and postures tried near each
STATES_MAX = 48  # states kept, those of the least lower bound that are apart from one another
APART_RAD = 0.35  # [rad] least difference of two kept states in some joint
BATCH = 64  # states compared with one another at once
TOO_FAST_S = 1e3  # [s] penalty per multiple of a speed limit: every state that is too fast comes after all others
SPREAD_RAD = np.array([np.pi, 1.8, 1.8, 2.2, 2.2, np.pi])  # [rad] farthest joint states from the start
FLIGHT_TIMES = (1.0, 0.8, 1.25, 0.6)  # [-] flight times tried, relative to that of the slowest throw


def least_time(distance: Array, qd: Array, limits: Limits) -> Array:
    """Returns a lower bound (...,) [s] on the time from rest over `distance` to the velocity `qd`.

    The maximum over the joints of each joint's own least time with unbounded jerk. Source: time-optimal control of a
    double integrator with bounded acceleration and velocity (Pontryagin; e.g. Biagiotti and Melchiorri, Trajectory
    Planning for Automatic Machines and Robots, Springer 2008, section 3.2).

    Args:
        distance: joint distances (..., n) [rad].
        qd: joint velocities (..., n) at the end [rad/s].
        limits: of velocity and acceleration.
    """
    v_max, a_max = limits.qd_max, limits.qdd_max
    turn = np.where(distance >= qd * np.abs(qd) / (2.0 * a_max), 1.0, -1.0)
    d, v = turn * distance, turn * qd
    peak = np.sqrt(np.maximum(a_max * d + v**2 / 2.0, 0.0))
    direct = (2.0 * peak - v) / a_max
    accelerating = (2.0 * v_max**2 - v**2) / (2.0 * a_max)
    cruising = (2.0 * v_max - v) / a_max + (d - accelerating) / v_max
    return np.where(peak <= v_max, direct, cruising).max(axis=-1)


def point_states(problem: ThrowProblem, release: PointRelease) -> tuple[Array, Array]:
    """Returns joint states (n, 6) that have the point's position and velocity, in evenly spread orientations.

    Raises:
        Infeasible: no posture reaches the point.
    """

    def states_near(q: Array) -> tuple[Array, Array]:
        q = _at_point(problem, release.p_WT, q)
        return q, _with_velocity(problem, q, release.v_WT)

    q = _postures(problem, release.p_WT)
    qd = _with_velocity(problem, q, release.v_WT)
    rows = _soonest(problem, q, qd)
    q, qd = _moved_nearby(problem, q[rows], qd[rows], states_near)
    rows = _soonest(problem, q, qd)
    return q[rows], qd[rows]


def _with_velocity(problem: ThrowProblem, q: Array, v_WT: Array) -> Array:
    """Returns the joint velocities (n, 6) with which the tool has the velocity `v_WT` (3,) in postures `q` (n, 6)."""
    R_BW = problem.cell.X_WB[:3, :3].T
    return allocate_velocity(tool_jacobian(problem, q), R_BW @ v_WT, problem.limits.qd_max)


def _at_point(problem: ThrowProblem, p_WT: Array, q: Array) -> Array:
    """Returns the postures (n, 6) closest to `q` (n, 6) that have the same orientation, and the tool at `p_WT` (3,).

    NaN where there is none, or it is too near a singularity.
    """
    cell, limits, turn = problem.cell, problem.reachable, 2.0 * np.pi
    X_WT = tool_pose(cell, q)
    X_WT[:, :3, 3] = p_WT
    branches, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    branches = branches - turn * np.round((branches - q[:, None]) / turn)
    away = np.abs(branches - q[:, None]).max(axis=2)
    found = branches[np.arange(len(q)), np.where(np.isfinite(away), away, np.inf).argmin(axis=1)]
    usable = np.all((found >= limits.q_lower) & (found <= limits.q_upper), axis=1)
    usable &= singularity_distances(cell.robot, found).minimum >= limits.singularity_distance_min
    return np.where(usable[:, None], found, np.nan)


def _postures(problem: ThrowProblem, p_WT: Array) -> Array:
    """Returns postures (n, 6) with the tool at `p_WT` (3,), in evenly spread orientations.

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


def _postures_in(problem: ThrowProblem, p_WT: Array, orientations: int) -> Array:
    X_WT = np.tile(np.eye(4), (orientations, 1, 1))
    X_WT[:, :3, :3] = quaternion_to_matrix(_quaternions(orientations))
    X_WT[:, :3, 3] = p_WT
    cell = problem.cell
    branches, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    q = _within_limits(problem.reachable, problem.start, branches.reshape(-1, 6))
    return q[singularity_distances(cell.robot, q).minimum >= problem.limits.singularity_distance_min]


def target_states(problem: ThrowProblem, release: TargetRelease) -> tuple[Array, Array]:
    """Returns joint states (n, 6) whose free flight hits the target within the requested bounds.

    Raises:
        Infeasible: there are none.
    """
    if release.release_position is not None:
        q = _postures(problem, release.release_position)
        return _flights(problem, release, q, np.broadcast_to(release.release_position, (len(q), 3)))
    limits = problem.reachable

    def states_near(q: Array) -> tuple[Array, Array]:
        q = np.clip(q, limits.q_lower, limits.q_upper)
        p, allowed = _release_positions(problem, release, q)
        return q, np.where(allowed[:, None], _best_flights(problem, release, q, p).qd, np.nan)

    centre = np.clip(problem.start, limits.q_lower, limits.q_upper)
    q = np.clip(centre + _offsets(POSTURES), limits.q_lower, limits.q_upper)
    p, allowed = _release_positions(problem, release, q)
    q, qd = _flights(problem, release, q[allowed], p[allowed])
    q, _ = _moved_nearby(problem, q, qd, states_near)
    return _flights(problem, release, q, tool_pose(problem.cell, q)[:, :3, 3])


def _release_positions(problem: ThrowProblem, release: TargetRelease, q: Array) -> tuple[Array, Mask]:
    """Returns the tool's positions p (n, 3) in postures `q` (n, 6), and the mask of those to release from."""
    p = tool_pose(problem.cell, q)[:, :3, 3]
    distance = np.linalg.norm((p - release.p_W)[:, :2], axis=1)
    allowed = (distance >= release.min_horizontal_distance_m) & _inside(problem, p)
    least = problem.limits.singularity_distance_min
    return p, allowed & (singularity_distances(problem.cell.robot, q).minimum >= least)


def _moved_nearby(
    problem: ThrowProblem, q: Array, qd: Array, states_near: Callable[[Array], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Returns the states q, qd (n, 6) with the first `MOVED` moved to sooner ones near them in which the arm is clear.

    Args:
        problem: the problem.
        q: postures (n, 6), the soonest first.
        qd: their joint velocities (n, 6).
        states_near: returns states q, qd (m, 6) next to postures (m, 6); NaN where there is none.
    """
    q, qd, body = q.copy(), qd.copy(), body_model(problem.cell)
    k = min(MOVED, len(q))
    bound = _penalised_bound(problem, q[:k], qd[:k])
    for offsets in _nearby_offsets():
        near_q, near_qd = states_near((q[:k, None] + offsets[:k]).reshape(-1, 6))
        near = _penalised_bound(problem, near_q, near_qd).reshape(k, NEARBY)
        moved = np.flatnonzero(near.min(axis=1) < bound)
        best = moved * NEARBY + near[moved].argmin(axis=1)
        clear = body.clearances(near_q[best]).least >= 0.0
        moved, best = moved[clear], best[clear]
        q[moved], qd[moved], bound[moved] = near_q[best], near_qd[best], near.ravel()[best]
    return q, qd


def _penalised_bound(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns the lower bounds (n,) [s] of states (n, 6), beyond all others where too fast; infinite for NaN."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=-1)
    bound = least_time(q - problem.start, qd, problem.limits)
    return np.where(np.isnan(excess + bound), np.inf, np.where(excess <= 1.0, bound, TOO_FAST_S * excess))


@dataclass(frozen=True, eq=False)
class _Flights:
    """The best flight of every posture.

    Attributes:
        qd: joint velocities (n, 6) [rad/s]; NaN where no flight keeps the bounds.
        t: flight times (n,) [s].
    """

    qd: Array
    t: Array


def _best_flights(problem: ThrowProblem, release: TargetRelease, q: Array, p: Array) -> _Flights:
    """Returns the best flight, without drag, from postures q (n, 6) with the tool at p (n, 3)."""
    t = np.outer(FLIGHT_TIMES, slowest_time(p, release.p_W, problem.gravity))
    v = launch_velocity(p, release.p_W, t, problem.gravity)
    ok = _allowed_velocity(release, v) & (v[..., 2] < problem.gravity * t)
    J, R_BW = tool_jacobian(problem, q), problem.cell.X_WB[:3, :3].T
    qd = allocate_velocity(J, v @ R_BW.T, problem.limits.qd_max, ok)
    rows = np.arange(len(q))
    best = np.where(ok, _penalised_bound(problem, q, qd), np.inf).argmin(axis=0)
    return _Flights(np.where(ok[best, rows, None], qd[best, rows], np.nan), t[best, rows])


def _flights(problem: ThrowProblem, release: TargetRelease, q: Array, p: Array) -> tuple[Array, Array]:
    """Returns, for postures q (n, 6) with the tool at p (n, 3), the joint states whose flights keep the bounds.

    Raises:
        Infeasible: there are none.
    """
    found = _best_flights(problem, release, q, p)
    postures = np.flatnonzero(np.isfinite(found.qd).all(axis=1))
    if len(postures) == 0:
        raise Infeasible([_no_flight(problem, release, p)])
    kept = postures[_soonest(problem, q[postures], found.qd[postures])]
    if problem.drag <= 0.0:
        return q[kept], found.qd[kept]
    v = launch_velocity(p[kept], release.p_W, found.t[kept], problem.gravity, problem.drag)
    hits = np.isfinite(v).all(axis=1) & _allowed_velocity(release, v)
    kept, v = kept[hits], v[hits]
    R_BW = problem.cell.X_WB[:3, :3].T
    return q[kept], allocate_velocity(tool_jacobian(problem, q[kept]), v @ R_BW.T, problem.limits.qd_max)


def tool_jacobian(problem: ThrowProblem, q: Array) -> Array:
    """Returns the linear Jacobian (n, 3, 6) [m/rad] of the tool centre, in the base frame."""
    return jacobian(problem.cell.robot, q, problem.cell.tool.X_FT)[:, :3, :]


def _allowed_velocity(release: TargetRelease, v: Array) -> Mask:
    """Returns the mask of the release velocities (..., 3) within the requested speed and elevations."""
    speed = np.linalg.norm(v, axis=-1)
    elevation = np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))
    allowed = (elevation >= release.min_elevation_rad) & (elevation <= release.max_elevation_rad)
    return allowed & (speed <= release.max_speed_m_s)


def _soonest(problem: ThrowProblem, q: Array, qd: Array) -> Index:
    """Returns the rows of up to `STATES_MAX` distinct states of least lower bound; if all are too fast, the slowest."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=1)
    usable = np.flatnonzero(excess <= 1.0)
    if len(usable) == 0:
        return np.argsort(excess, kind="stable")[:STATES_MAX]
    bound = least_time(q[usable] - problem.start, qd[usable], problem.limits)
    order = usable[np.argsort(bound, kind="stable")]
    return order[_apart(q[order])]


def _apart(q: Array) -> Index:
    """Returns the first `STATES_MAX` rows of `q` (n, 6) that are apart from every row kept before them."""
    kept: list[int] = []
    for begin in range(0, len(q), BATCH):
        batch = q[begin : begin + BATCH]
        free = np.asarray(_differ(batch, q[kept]).all(axis=1))
        apart = _differ(batch, batch)
        for i in range(len(batch)):
            if free[i]:
                kept.append(begin + i)
                free &= apart[i]
        if len(kept) >= STATES_MAX:
            break
    return np.array(kept[:STATES_MAX], dtype=np.intp)


def _differ(a: Array, b: Array) -> Mask:
    """Returns the mask (n, m) of rows of `a` (n, 6) and `b` (m, 6) that are apart."""
    return np.asarray((np.abs(a[:, None] - b) > APART_RAD).any(axis=2))


def _within_limits(limits: Limits, start: Array, q: Array) -> Array:
    """Returns the finite postures of `q` (m, 6), each joint turned next to `start`, that are within the limits."""
    turn = 2.0 * np.pi
    q = q[np.isfinite(q).all(axis=1)]
    q = q + turn * np.round((start - q) / turn)
    q = np.where(q > limits.q_upper, q - turn, q)
    q = np.where(q < limits.q_lower, q + turn, q)
    return q[np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1)]


def _inside(problem: ThrowProblem, p: Array) -> Mask:
    """Returns the mask of the positions (n, 3) above the floor, inside every keep-in and outside every keep-out box."""
    around = problem.cell.surroundings
    ok = p[:, 2] > around.floor_z_m + around.clearance_m + problem.cell.object.radius_m
    for box in around.keep_in:
        ok &= np.all((p >= box.lower) & (p <= box.upper), axis=1)
    for box in around.keep_out:
        ok &= ~np.all((p >= box.lower) & (p <= box.upper), axis=1)
    return ok


def _unreachable(problem: ThrowProblem, p_W: Array) -> Violation:
    """Returns why no posture has the tool at a position (3,): its distance, or the joint limits."""
    distance, reach = float(np.linalg.norm(p_W - problem.cell.X_WB[:3, 3])), farthest_reach(problem)
    if distance > reach:
        return Violation("reach", distance, reach, "m", detail="distance from the arm's base")
    detail = "no posture within the joint limits brings the tool there"
    return Violation("joint_position", distance, reach, "m", detail=detail)


def farthest_reach(problem: ThrowProblem) -> float:
    """Returns an upper bound on the tool centre's distance from the base [m]: the sum of all link lengths."""
    robot = problem.cell.robot
    return float(np.hypot(robot.a, robot.d).sum() + np.linalg.norm(problem.cell.tool.X_FT[:3, 3]))


def _no_flight(problem: ThrowProblem, release: TargetRelease, p: Array) -> Violation:
    """Returns why no flight from the positions (n, 3) hits the target: there is none, or it takes too much speed."""
    if len(p) == 0:
        least = release.min_horizontal_distance_m
        detail = "no release position obeys keep-in boxes, floor and distance to the target"
        return Violation("release_position", 0.0, least, "m", detail=detail)
    speed = float(least_speed(p, release.p_W, problem.gravity).min())
    detail = "least speed that hits the target within the requested elevations"
    return Violation("release_velocity", speed, release.max_speed_m_s, "m/s", detail=detail)


@cache
def _halton(count: int, dimension: int) -> Array:
    """Returns a Halton sequence (count, dimension) in (0, 1).

    Source: Halton 1960, doi 10.1007/BF01386213.
    """
    primes = (2, 3, 5, 7, 11, 13)[:dimension]
    columns = []
    for prime in primes:
        index, value, scale = np.arange(1, count + 1), np.zeros(count), 1.0 / prime
        while index.any():
            value += scale * (index % prime)
            index, scale = index // prime, scale / prime
        columns.append(value)
    return read_only(np.stack(columns, axis=1))


def _quaternions(count: int) -> Array:
    """Returns evenly spread unit quaternions (count, 4). Source: Shoemake, Graphics Gems III (1992), p. 124."""
    u = _halton(count, 3)
    angle_1, angle_2 = 2.0 * np.pi * u[:, 1], 2.0 * np.pi * u[:, 2]
    low, high = np.sqrt(1.0 - u[:, 0]), np.sqrt(u[:, 0])
    return np.stack(
        [low * np.sin(angle_1), low * np.cos(angle_1), high * np.sin(angle_2), high * np.cos(angle_2)], axis=1
    )


@cache
def _nearby_offsets() -> tuple[Array, ...]:
    """Returns joint offsets (MOVED, NEARBY, 6) [rad] for each of `NEARBY_SHARES`."""
    offsets = _offsets(len(NEARBY_SHARES) * MOVED * NEARBY).reshape(len(NEARBY_SHARES), MOVED, NEARBY, 6)
    return tuple(read_only(share * each) for share, each in zip(NEARBY_SHARES, offsets, strict=True))


def _offsets(count: int) -> Array:
    """Returns joint offsets (count, 6) [rad], denser near zero: the soonest throws are close to the start."""
    u = 2.0 * _halton(count, 6) - 1.0
    return SPREAD_RAD * np.sign(u) * np.abs(u) ** 1.5
