"""Release states for releases that leave something free, drawn from a fixed quasi-random sequence.

A `point` leaves the tool's orientation and turning free; a `target` leaves place, direction and speed free too.
Joint velocities are the weighted least-norm ones: qd = W J^T (J W J^T)^-1 v with W = diag(qd_max^2), which spreads a
speed over the joints that can bear it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from planner.ballistics import launch_velocity, least_speed, slowest_time
from planner.cell import Limits
from planner.errors import Infeasible, Violation
from planner.kinematics import forward, inverse_branches, jacobian, singularity_distances
from planner.lower_bound import least_time
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import invert_pose, quaternion_to_matrix

Vector = NDArray[np.float64]

ORIENTATIONS = 96  # of the tool tried at a point
PLACES = 1536  # joint states tried for a target
KEPT = 48  # of them, the soonest, kept apart from one another
APART_RAD = 0.35  # two kept states differ by this in some joint
FLIGHT_STRETCH = (1.0, 0.8, 1.25, 0.6)  # flight times tried, as shares of the slowest throw's


def point_states(problem: ThrowProblem, release: PointRelease) -> tuple[Vector, Vector]:
    """Returns joint states (n, 6) at the point with its velocity, for orientations all round.

    Raises:
        Infeasible: no orientation brings the tool there.
    """
    X_WT = np.tile(np.eye(4), (ORIENTATIONS, 1, 1))
    X_WT[:, :3, :3] = quaternion_to_matrix(_quaternions(ORIENTATIONS))
    X_WT[:, :3, 3] = release.p_WT
    branches, _ = inverse_branches(problem.cell.robot, invert_pose(problem.cell.X_WB) @ X_WT, problem.cell.tool.X_FT)
    q = _within(problem, branches)
    if len(q) == 0:
        raise Infeasible([_unreachable(problem, release.p_WT)])
    qd = spread_velocity(problem, q, np.broadcast_to(release.v_WT, (len(q), 3)))
    return _soonest(problem, q, qd)


def target_states(problem: ThrowProblem, release: TargetRelease) -> tuple[Vector, Vector]:
    """Returns joint states (n, 6) from which free flight hits the target within the bounds asked for.

    Raises:
        Infeasible: no state was found whose flight hits.
    """
    if release.release_position is not None:
        return _fixed_place_states(problem, release, release.release_position)
    limits = problem.limits
    centre = np.clip(problem.start, limits.q_lower, limits.q_upper)
    q = np.clip(centre + _spread(PLACES), limits.q_lower, limits.q_upper)
    cell = problem.cell
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    away = np.linalg.norm((p - release.p_W)[:, :2], axis=1)
    allowed = (away >= release.min_horizontal_distance_m) & _inside(problem, p)
    allowed &= singularity_distances(cell.robot, q).minimum >= limits.singularity_distance_min
    q, p = q[allowed], p[allowed]
    return _flights(problem, release, q, p)


def _fixed_place_states(problem: ThrowProblem, release: TargetRelease, place: Vector) -> tuple[Vector, Vector]:
    speed = float(least_speed(place, release.p_W, problem.gravity))
    q, _ = point_states(problem, PointRelease(place, np.array([0.0, 0.0, max(speed, 1e-3)])))
    return _flights(problem, release, q, np.broadcast_to(place, (len(q), 3)))


def _flights(problem: ThrowProblem, release: TargetRelease, q: Vector, p: Vector) -> tuple[Vector, Vector]:
    """Returns for the places (n, 3) the joint states whose flights obey the bounds, for several flight times each."""
    states = []
    for stretch in FLIGHT_STRETCH:
        v = _launches(problem, release, p, stretch)
        ok = np.isfinite(v).all(axis=1) & _allowed_velocity(release, v)
        if ok.any():
            states.append((q[ok], spread_velocity(problem, q[ok], v[ok])))
    if not states:
        raise Infeasible([_no_flight(problem, release, p)])
    return _soonest(problem, np.concatenate([s[0] for s in states]), np.concatenate([s[1] for s in states]))


def _launches(problem: ThrowProblem, release: TargetRelease, p: Vector, stretch: float) -> Vector:
    """Returns launch velocities (n, 3) whose flight lasts `stretch` times that of the slowest throw."""
    d = release.p_W - p
    t = stretch * np.sqrt(2.0 * np.linalg.norm(d, axis=1) / problem.gravity)
    v = d / t[:, None] + np.array([0.0, 0.0, 0.5 * problem.gravity]) * t[:, None]
    coming_down = v[:, 2] - problem.gravity * t < 0.0
    return np.where(coming_down[:, None], v, np.nan)


def _allowed_velocity(release: TargetRelease, v: Vector) -> Vector:
    speed = np.linalg.norm(v, axis=1)
    elevation = np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1]))
    return (
        (speed <= release.max_speed_m_s)
        & (elevation >= release.min_elevation_rad)
        & (elevation <= release.max_elevation_rad)
    )


def drag_corrected(problem: ThrowProblem, p: Vector, v: Vector) -> Vector | None:
    """Returns the launch velocity (3,) that hits a target with drag where `v` hits it without, None where none does."""
    assert isinstance(problem.release, TargetRelease)
    time = slowest_time(p, problem.release.p_W, problem.gravity)
    flat = problem.release.p_W - p
    share = np.linalg.norm(flat[:2]) / max(float(np.linalg.norm(v[:2])), 1e-9)
    return launch_velocity(p, problem.release.p_W, share or time, problem.gravity, problem.drag)


def spread_velocity(problem: ThrowProblem, q: Vector, v_W: Vector) -> Vector:
    """Returns the weighted least-norm joint velocities (n, 6) for tool velocities `v_W` (n, 3) in the world."""
    cell, weight = problem.cell, problem.limits.qd_max**2
    J = jacobian(cell.robot, q, cell.tool.X_FT)[:, :3, :]
    v_B = v_W @ cell.X_WB[:3, :3]
    gram = np.einsum("nij,j,nkj->nik", J, weight, J) + 1e-12 * np.eye(3)
    return weight * np.einsum("nij,ni->nj", J, np.linalg.solve(gram, v_B[..., None])[..., 0])


def _soonest(problem: ThrowProblem, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
    """Returns the KEPT states of least bound that differ from one another; too fast ones only where all are."""
    excess = np.max(np.abs(qd) / problem.limits.qd_max, axis=1)
    ok = excess <= 1.0
    if not ok.any():
        best = np.argsort(excess, kind="stable")[:KEPT]
        return q[best], qd[best]
    q, qd = q[ok], qd[ok]
    order = np.argsort(least_time(q - problem.start, qd, problem.limits), kind="stable")
    kept: list[int] = []
    for i in order:
        if all(np.abs(q[i] - q[k]).max() > APART_RAD for k in kept):
            kept.append(int(i))
        if len(kept) == KEPT:
            break
    return q[kept], qd[kept]


def _within(problem: ThrowProblem, q: Vector) -> Vector:
    """Returns those of the inverse kinematics' branches (m, 8, 6), in every turn, that lie within the limits (n, 6)."""
    q = q.reshape(-1, 6)
    q = q[np.isfinite(q).all(axis=1)]
    return _turned_into(problem.limits, problem.start, q)


def _turned_into(limits: Limits, start: Vector, q: Vector) -> Vector:
    """Returns `q` (n, 6) with every joint turned by whole turns next to `start`, those within the limits only."""
    turn = 2.0 * np.pi
    q = q + turn * np.round((start - q) / turn)
    q = np.where(q > limits.q_upper, q - turn, q)
    q = np.where(q < limits.q_lower, q + turn, q)
    return q[np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1)]


def _inside(problem: ThrowProblem, p: Vector) -> Vector:
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
    return Violation("joint_position", away, reach, "m", detail="no posture within the joint limits brings the tool there")


def farthest_reach(problem: ThrowProblem) -> float:
    """Returns how far from the base no point of the tool can be [m]: the sum of all link lengths and the tool's."""
    robot = problem.cell.robot
    return float(np.hypot(robot.a, robot.d).sum() + np.linalg.norm(problem.cell.tool.X_FT[:3, 3]))


def _no_flight(problem: ThrowProblem, release: TargetRelease, p: Vector) -> Violation:
    if len(p) == 0:
        return Violation("release_position", 0.0, release.min_horizontal_distance_m, "m",
                         detail="no release place obeys keep-in boxes, floor and distance to the target")
    speed = float(least_speed(p, release.p_W, problem.gravity).min())
    return Violation("release_velocity", speed, release.max_speed_m_s, "m/s",
                     detail="least speed that hits the target within the elevations asked for")


@cache
def _halton(count: int, dimension: int) -> Vector:
    """Returns a Halton sequence (count, dimension) in (0, 1): deterministic and evenly spread.

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
    points = np.stack(columns, axis=1)
    points.setflags(write=False)
    return points


def _quaternions(count: int) -> Vector:
    """Returns unit quaternions (count, 4) spread evenly. Source: Shoemake, Graphics Gems III (1992), p. 124."""
    u = _halton(count, 3)
    angle_1, angle_2 = 2.0 * np.pi * u[:, 1], 2.0 * np.pi * u[:, 2]
    low, high = np.sqrt(1.0 - u[:, 0]), np.sqrt(u[:, 0])
    return np.stack([low * np.sin(angle_1), low * np.cos(angle_1), high * np.sin(angle_2), high * np.cos(angle_2)], axis=1)


def _spread(count: int) -> Vector:
    """Returns joint offsets (count, 6) [rad] from the start: dense near it, as the soonest throws are, but far too."""
    u = 2.0 * _halton(count, 6) - 1.0
    return np.array([np.pi, 1.8, 1.8, 2.2, 2.2, np.pi]) * np.sign(u) * np.abs(u) ** 1.5
