"""Joint states for releases that leave something free, drawn from a fixed quasi-random sequence, soonest first.

A `point` leaves the tool's orientation and angular velocity free; a `target` leaves the release position, the direction
and the speed free, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from planner.arrays import Array, Index, Mask, read_only
from planner.cell import Cell, Limits
from planner.errors import Infeasible, Violation
from planner.flight import launch_velocity, least_speed, slowest_time
from planner.geometry import tool_pose
from planner.kinematics import inverse_branches, jacobian, singularity_distances
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import invert_pose, quaternion_to_matrix
from planner.seeds.velocity_allocation import allocate_velocity

ORIENTATIONS = 96  # tool orientations tried at a point
MORE_ORIENTATIONS, FEW_POSTURES = 1024, 24  # tried instead where those give fewer postures: narrow joint limits
POSTURES, MORE_POSTURES = 1024, 8192  # joint states tried for a target; where no throw from the first is slow enough
POSTURES_KEPT = 8  # draws cached: two for each start of late
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
    q = _postures(problem, release.p_WT)
    R_BW = problem.cell.X_WB[:3, :3].T
    qd = allocate_velocity(tool_jacobian(problem, q), R_BW @ release.v_WT, problem.limits.qd_max)
    rows = _soonest(problem, q, qd)
    return q[rows], qd[rows]


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


def target_states(problem: ThrowProblem, release: TargetRelease, wide: bool = True) -> tuple[Array, Array]:
    """Returns joint states (n, 6) whose free flight hits the target within the requested bounds.

    Raises:
        Infeasible: there are none.
    """
    if release.release_position is not None:
        q = _postures(problem, release.release_position)
        return _flights(problem, release, q, np.broadcast_to(release.release_position, (len(q), 3)))
    try:
        q, qd = _thrown_from(problem, release, POSTURES)
        if not wide or np.any(np.all(np.abs(qd) <= problem.limits.qd_max, axis=1)):
            return q, qd
    except Infeasible:
        if not wide:
            raise
    return _thrown_from(problem, release, MORE_POSTURES)


def _thrown_from(problem: ThrowProblem, release: TargetRelease, postures: int) -> tuple[Array, Array]:
    """Returns the joint states (n, 6) of `target_states` among so many postures.

    Raises:
        Infeasible: there are none.
    """
    q, p = _throwing_postures(_PostureKey.of(problem, postures))
    distance = np.linalg.norm((p - release.p_W)[:, :2], axis=1)
    allowed = distance >= release.min_horizontal_distance_m
    q, p = q[allowed], p[allowed]
    slow = least_speed(p, release.p_W, problem.gravity) <= _speed_limit(problem, release)
    if not slow.any():
        raise Infeasible([_no_flight(problem, release, p)])
    return _flights(problem, release, q[slow], p[slow])


@dataclass(frozen=True)
class _PostureKey:
    """What the postures drawn for targets depend on."""

    cell: Cell
    start: bytes
    q_limits: bytes
    singularity_distance_min: float
    count: int

    @staticmethod
    def of(problem: ThrowProblem, count: int) -> _PostureKey:
        """Returns the key of `count` postures for a problem."""
        limits = problem.reachable
        bounds = np.stack([limits.q_lower, limits.q_upper]).tobytes()
        return _PostureKey(problem.cell, problem.start.tobytes(), bounds, limits.singularity_distance_min, count)


@lru_cache(maxsize=POSTURES_KEPT)
def _throwing_postures(key: _PostureKey) -> tuple[Array, Array]:
    """Returns postures q (n, 6) clear of singularities, and their tool positions (n, 3) within the surroundings."""
    lower, upper = np.frombuffer(key.q_limits).reshape(2, 6)
    q = np.clip(np.clip(np.frombuffer(key.start), lower, upper) + _offsets(key.count), lower, upper)
    p = tool_pose(key.cell, q)[:, :3, 3]
    allowed = _inside(key.cell, p)
    allowed &= singularity_distances(key.cell.robot, q).minimum >= key.singularity_distance_min
    return read_only(q[allowed]), read_only(p[allowed])


def _flights(problem: ThrowProblem, release: TargetRelease, q: Array, p: Array) -> tuple[Array, Array]:
    """Returns, for postures q (n, 6) with the tool at p (n, 3), the joint states whose flights keep the bounds.

    Raises:
        Infeasible: there are none.
    """
    t = np.outer(FLIGHT_TIMES, slowest_time(p, release.p_W, problem.gravity))
    v = launch_velocity(p, release.p_W, t, problem.gravity)
    ok = _allowed_velocity(problem, release, v) & (v[..., 2] < problem.gravity * t)
    if not ok.any():
        raise Infeasible([_no_flight(problem, release, p)])
    J, R_BW = tool_jacobian(problem, q), problem.cell.X_WB[:3, :3].T
    qd = allocate_velocity(J, v @ R_BW.T, problem.limits.qd_max, ok)
    best = _best_flight(problem, q, qd, ok)
    postures = np.flatnonzero(ok.any(axis=0))
    qd = qd[best[postures], postures]
    rows = _soonest(problem, q[postures], qd)
    kept, qd = postures[rows], qd[rows]
    if problem.drag <= 0.0:
        return q[kept], qd
    v = launch_velocity(p[kept], release.p_W, t[best[kept], kept], problem.gravity, problem.drag)
    hits = np.isfinite(v).all(axis=1) & _allowed_velocity(problem, release, v)
    kept, v = kept[hits], v[hits]
    return q[kept], allocate_velocity(J[kept], v @ R_BW.T, problem.limits.qd_max)


def _best_flight(problem: ThrowProblem, q: Array, qd: Array, ok: Mask) -> Index:
    """Returns which of the flights qd (k, n, 6) of every posture (n, 6) is soonest, or exceeds its limits least."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=-1)
    bound = least_time(q - problem.start, qd, problem.limits)
    penalty = np.where(excess <= 1.0, bound, TOO_FAST_S * excess)
    return np.where(ok, penalty, np.inf).argmin(axis=0)


def tool_jacobian(problem: ThrowProblem, q: Array) -> Array:
    """Returns the linear Jacobian (n, 3, 6) [m/rad] of the tool centre, in the base frame."""
    return jacobian(problem.cell.robot, q, problem.cell.tool.X_FT)[:, :3, :]


def _allowed_velocity(problem: ThrowProblem, release: TargetRelease, v: Array) -> Mask:
    """Returns the mask of the release velocities (..., 3) within the requested elevations and the limits on speed."""
    speed = np.linalg.norm(v, axis=-1)
    elevation = np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))
    allowed = (elevation >= release.min_elevation_rad) & (elevation <= release.max_elevation_rad)
    return allowed & (speed <= _speed_limit(problem, release))


def _speed_limit(problem: ThrowProblem, release: TargetRelease) -> float:
    """Returns the highest release speed [m/s] that request and cell allow."""
    return min(release.max_speed_m_s, problem.limits.tcp_speed_max)


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


def _inside(cell: Cell, p: Array) -> Mask:
    """Returns the mask of the positions (n, 3) above the floor, inside every keep-in and outside every keep-out box."""
    around = cell.surroundings
    ok = p[:, 2] > around.floor_z_m + around.clearance_m + cell.object.radius_m
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
    name = "release_velocity" if release.max_speed_m_s < problem.limits.tcp_speed_max else "tcp_speed"
    detail = f"least speed that hits the target within the requested elevations, from {len(p)} postures tried"
    return Violation(name, speed, _speed_limit(problem, release), "m/s", detail=detail)


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
def _offsets(count: int) -> Array:
    """Returns joint offsets (count, 6) [rad], denser near zero: the soonest throws are close to the start."""
    u = 2.0 * _halton(count, 6) - 1.0
    return read_only(SPREAD_RAD * np.sign(u) * np.abs(u) ** 1.5)
