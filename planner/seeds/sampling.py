"""Joint states for releases that leave something free, drawn from a fixed quasi-random sequence, soonest first.

A `point` leaves the tool's orientation and angular velocity free; a `target` leaves the release position, the direction
and the speed free, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Limits
from planner.errors import Infeasible, Violation, nothing_found
from planner.flight import time_of_flight
from planner.geometry import body_model, tool_pose
from planner.kinematics import inverse_branches, singularity_distances
from planner.problem import ThrowProblem
from planner.releases import PointState, Target
from planner.rotations import invert_pose, quaternion_to_matrix
from planner.seeds.flight_filter import (
    clear_flights,
    least_room,
    no_clear_flight,
)
from planner.seeds.landing_axes import aimed_at, thrown_velocity
from planner.seeds.launches import (
    allowed_velocity,
    far_enough,
    is_slow_enough,
    launches,
    no_flight,
    with_drag,
)
from planner.seeds.quasi_random import quaternions
from planner.seeds.run_ups import run_ups
from planner.seeds.soonest_states import penalised_bound, soonest
from planner.seeds.throwing_postures import MORE_POSTURES, POSTURES, throwing, throwing_postures
from planner.seeds.velocity_allocation import allocate_velocity, tool_jacobian, tool_velocity

ORIENTATIONS = 96  # tool orientations tried at a point
MORE_ORIENTATIONS = 1024
FEW = 6  # postures at a point, throws slow enough, or candidates behind obstacles: fewer call for more draws
NO_TOUCH = "no joint state was found with which the object first touches what is at the target there"
NO_SPIN = "no spin was found with which the object lands along that axis"
CHECKED_MAX = 1536  # soonest of these states whose clearance is checked before they are compared: 40 ms


def point_states(problem: ThrowProblem, point: PointState) -> tuple[Array, Array]:
    """Returns joint states (n, 6) that have the point's position and velocity, in evenly spread orientations.

    Raises:
        Infeasible: no posture reaches the point.
    """
    q = _postures(problem, point.p_WT)
    qd = with_velocity(problem, q, point.v_WT)
    return soonest(problem, q, qd)


def with_velocity(problem: ThrowProblem, q: Array, v_WT: Array) -> Array:
    """Returns the joint velocities (n, 6) with which the tool has the velocity `v_WT` (3,) in postures `q` (n, 6)."""
    v_B = problem.cell.X_WB[:3, :3].T @ v_WT
    return allocate_velocity(tool_jacobian(problem, q), v_B, problem.limits.qd_max)


def _postures(problem: ThrowProblem, p_WT: Array) -> Array:
    """Returns postures (n, 6) with the tool at `p_WT` (3,), in evenly spread orientations.

    Raises:
        Infeasible: there are none.
    """
    for orientations in (ORIENTATIONS, MORE_ORIENTATIONS):
        q = _postures_in(problem, p_WT, orientations)
        if len(q) >= FEW:
            break
    if len(q) == 0:
        raise Infeasible([_unreachable(problem, p_WT)])
    return q


def _postures_in(problem: ThrowProblem, p_WT: Array, orientations: int) -> Array:
    X_WT = np.tile(np.eye(4), (orientations, 1, 1))
    X_WT[:, :3, :3] = quaternion_to_matrix(quaternions(orientations))
    X_WT[:, :3, 3] = p_WT
    cell = problem.cell
    branches, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    q = _within_limits(problem.reachable, problem.start, branches.reshape(-1, 6))
    return q[singularity_distances(cell.robot, q).minimum >= problem.limits.singularity_distance_min]


def target_states(problem: ThrowProblem, target: Target, thorough: bool = False) -> tuple[Array, Array]:
    """Returns joint states (n, 6) whose free flight hits the target within the requested bounds, clear of obstacles.

    Args:
        problem: the problem.
        target: of the throw.
        thorough: whether to try `MORE_POSTURES`, and leave out those in which the arm is not clear.

    Raises:
        Infeasible: there are none.
    """
    target = aimed_at(problem, target)
    q, qd = _thrown(problem, target, thorough)
    if thorough:
        q, qd = _clear_of_obstacles(problem, q, qd)
    if target.release_position is None:
        q, qd = _with_run_ups(problem, target, q, qd)
    q, qd = soonest(problem, q, qd)
    return (q, qd) if problem.drag <= 0.0 else _with_drag(problem, target, q, qd)


def _with_run_ups(problem: ThrowProblem, target: Target, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns the states q, qd (n, 6) and before them the run-ups whose flights keep the requested bounds."""
    run_q, run_qd = run_ups(problem, target)
    p = tool_pose(problem.cell, run_q)[:, :3, 3]
    v = tool_velocity(tool_jacobian(problem, run_q), run_qd) @ problem.cell.X_WB[:3, :3].T
    kept = far_enough(target, p) & throwing(problem.cell, run_q, p, problem.limits.singularity_distance_min)
    kept &= allowed_velocity(problem, target, v)
    kept[kept] = clear_flights(problem, target, p[kept], v[kept])
    run_q = run_q[kept]
    run_qd = run_qd[kept]
    if problem.body is not None:
        J = tool_jacobian(problem, run_q)
        run_qd = thrown_velocity(problem, target, run_q, J, tool_velocity(J, run_qd))
        spun = np.isfinite(run_qd).all(axis=1)
        run_q = run_q[spun]
        run_qd = run_qd[spun]
    return np.concatenate([run_q, q]), np.concatenate([run_qd, qd])


def _thrown(problem: ThrowProblem, target: Target, thorough: bool) -> tuple[Array, Array]:
    """Returns joint states (n, 6) whose flights hit the target: of many postures, too, where few are slow enough.

    Raises:
        Infeasible: there are none.
    """
    if target.release_position is not None:
        return _thrown_at(problem, target, target.release_position)
    if thorough:
        return _thrown_from(problem, target, thorough=True)
    try:
        found = _thrown_from(problem, target, thorough=False)
    except Infeasible:
        return _thrown_from(problem, target, thorough=True)
    if _has_enough(problem, target, found[1]):
        return found
    return _with_more(problem, found, partial(_thrown_from, problem, target, thorough=True))


def _thrown_at(problem: ThrowProblem, target: Target, p: Array) -> tuple[Array, Array]:
    """Returns joint states (n, 6) as `_thrown` does, from a given place (3,), in more orientations where it does.

    Raises:
        Infeasible: there are none.
    """

    def thrown(q: Array) -> tuple[Array, Array]:
        return _flights(problem, target, q, np.broadcast_to(p, q[:, :3].shape))

    found = thrown(_postures(problem, p))
    if _has_enough(problem, target, found[1]):
        return found
    return _with_more(problem, found, lambda: thrown(_postures_in(problem, p, MORE_ORIENTATIONS)))


def _with_more(
    problem: ThrowProblem, found: tuple[Array, Array], more: Callable[[], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Returns further joint states q, qd (n, 6) after those of the ones found that are slow enough.

    Raises:
        Infeasible: there are neither.
    """
    slow = _is_slow(problem, found[1])
    try:
        q, qd = more()
    except Infeasible:
        if not slow.any():
            raise
        return found[0][slow], found[1][slow]
    return np.concatenate([found[0][slow], q]), np.concatenate([found[1][slow], qd])


def _has_enough(problem: ThrowProblem, target: Target, qd: Array) -> bool:
    """Returns whether some joint velocities (n, 6) keep their limits: a few, where elevations or landings are bounded.

    With bounds a posture's only flight is mostly one at an end of the range, and others release in a third of the time.
    Motions go to the states of a body as they are, and few are slow enough with a spin.
    """
    is_bounded = target.min_elevation_rad > -np.pi / 2 or target.max_elevation_rad < np.pi / 2
    is_bounded |= problem.body is not None
    return int(_is_slow(problem, qd).sum()) >= (FEW if is_bounded else 1)


def _is_slow(problem: ThrowProblem, qd: Array) -> Mask:
    """Returns which joint velocities (n, 6) keep their limits."""
    return np.asarray((np.abs(qd) <= problem.limits.qd_max).all(axis=1))


def _thrown_from(problem: ThrowProblem, target: Target, thorough: bool) -> tuple[Array, Array]:
    """Returns the joint states (n, 6) of `_thrown` among `POSTURES` or, in a thorough search, `MORE_POSTURES`.

    Raises:
        Infeasible: there are none.
    """
    q, p = throwing_postures(problem, MORE_POSTURES if thorough else POSTURES)
    allowed = far_enough(target, p)
    q = q[allowed]
    p = p[allowed]
    if len(p) == 0:
        raise Infeasible([_no_posture(problem, target)])
    slow = is_slow_enough(problem, target, p)
    if not slow.any():
        raise Infeasible([no_flight(problem, target, p)])
    return _flights(problem, target, q[slow], p[slow])


def _no_posture(problem: ThrowProblem, target: Target) -> Violation:
    """Returns which limit leaves no posture to throw from."""
    apart_m = target.min_horizontal_distance_m
    if apart_m > 0.0 and len(throwing_postures(problem, MORE_POSTURES)[1]):
        return nothing_found("release_position", f"no posture was found at least {apart_m:g} m from the target")
    distance = problem.limits.singularity_distance_min
    anywhere = replace(problem, limits=replace(problem.limits, singularity_distance_min=0.0))
    if len(throwing_postures(anywhere, POSTURES)[1]):
        return nothing_found("singularity_distance", f"no posture was found that keeps {distance:g} from singularities")
    name = "keep_in" if problem.cell.surroundings.keep_in else "floor"
    return nothing_found(name, "no posture was found with the tool above the floor and within every keep-in box")


def _flights(problem: ThrowProblem, target: Target, q: Array, p: Array) -> tuple[Array, Array]:
    """Returns the soonest joint state of every posture q (n, 6), tool at p (n, 3), that has a flight within the bounds.

    Raises:
        Infeasible: there are none.
    """
    qd = _best_flights(problem, target, q, p)
    rows = np.flatnonzero(np.isfinite(qd).all(axis=1))
    if len(rows):
        return q[rows], qd[rows]
    v, allowed = launches(problem, target, p)
    if not allowed.any():
        raise Infeasible([no_flight(problem, target, p)])
    if problem.body is not None and clear_flights(problem, target, p, v)[allowed].any():
        asks = target.orientation is not None
        raise Infeasible([nothing_found("landing_axis", NO_SPIN) if asks else nothing_found("landing", NO_TOUCH)])
    p = np.broadcast_to(p, v.shape)[allowed]
    v = v[allowed]
    raise Infeasible([no_clear_flight(problem, target, p, v, len(p))])


def _best_flights(problem: ThrowProblem, target: Target, q: Array, p: Array) -> Array:
    """Returns the joint velocities (n, 6) of every posture's soonest drag-free flight, tool at p (n, 3); NaN: none."""
    v, ok = launches(problem, target, p)
    ok[ok] = clear_flights(problem, target, np.broadcast_to(p, v.shape)[ok], v[ok])
    found = np.full(q.shape, np.nan)
    rows = np.flatnonzero(ok.any(axis=0))
    if len(rows) == 0:
        return found
    q = q[rows]
    v = v[:, rows]
    ok = ok[:, rows]
    of = np.nonzero(ok)[1]  # posture of every flight
    J = tool_jacobian(problem, q)
    R_BW = problem.cell.X_WB[:3, :3].T
    qd = thrown_velocity(problem, target, q[of], J[of], v[ok] @ R_BW.T)
    bound = np.full(ok.shape, np.inf)
    flight = np.zeros(ok.shape, dtype=np.intp)
    bound[ok] = penalised_bound(problem, q[of], qd)
    flight[ok] = np.arange(len(of))
    least = bound.argmin(axis=0), np.arange(len(q))
    found[rows] = np.where(ok[least][:, None], qd[flight[least]], np.nan)
    return found


def _clear_of_obstacles(problem: ThrowProblem, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns those of the soonest `CHECKED_MAX` joint states (n, 6) in which the arm is clear; all if none is."""
    order = np.argsort(penalised_bound(problem, q, qd), kind="stable")[:CHECKED_MAX]
    clear = order[body_model(problem.cell_with_bin).clearances(q[order], problem.holds_object).least >= 0.0]
    rows = clear if len(clear) else order
    return q[rows], qd[rows]


def blocked_flights(problem: ThrowProblem, target: Target) -> Violation | None:
    """Returns what is in the way of all flights from postures in which the arm is clear; None if some are clear."""
    q, p = throwing_postures(problem, MORE_POSTURES)
    far = far_enough(target, p)
    q = q[far]
    p = p[far]
    v, allowed = launches(problem, target, p)
    room = np.full(allowed.shape, -np.inf)
    room[allowed] = least_room(problem, target, np.broadcast_to(p, v.shape)[allowed], v[allowed])
    body = body_model(problem.cell_with_bin)
    order = np.argsort(-room.max(axis=0), kind="stable")
    for rows in (order[i : i + CHECKED_MAX] for i in range(0, len(order), CHECKED_MAX)):
        clear = rows[body.clearances(q[rows], problem.holds_object).least >= 0.0]
        if len(clear):
            flight = int(room[:, clear[0]].argmax())
            blocked = -np.inf < room[flight, clear[0]] < 0.0
            best = p[clear[:1]], v[flight, clear[:1]]
            return no_clear_flight(problem, target, *best, int(allowed.sum())) if blocked else None
    return None


def _with_drag(problem: ThrowProblem, target: Target, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns the states (n, 6) whose flights with drag hit the target in the same time, as far as there are any."""
    p = tool_pose(problem.cell, q)[:, :3, 3]
    J = tool_jacobian(problem, q)
    R_WB = problem.cell.X_WB[:3, :3]
    v = tool_velocity(J, qd) @ R_WB.T
    t = time_of_flight(p[:, 2] - target.p_W[2], v[:, 2], problem.gravity_at_tool_speed)
    v = with_drag(problem, target, p, t)
    hits = np.isfinite(v).all(axis=1) & allowed_velocity(problem, target, v)
    qd = thrown_velocity(problem, target, q[hits], J[hits], v[hits] @ R_WB, problem.drag)
    spun = np.isfinite(qd).all(axis=1)
    return q[hits][spun], qd[spun]


def _within_limits(limits: Limits, start: Array, q: Array) -> Array:
    """Returns the finite postures of `q` (m, 6), each joint turned next to `start`, that are within the limits."""
    turn = 2.0 * np.pi
    q = q[np.isfinite(q).all(axis=1)]
    q = q + turn * np.round((start - q) / turn)
    q = np.where(q > limits.q_upper, q - turn, q)
    q = np.where(q < limits.q_lower, q + turn, q)
    return q[np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1)]


def _unreachable(problem: ThrowProblem, p_W: Array) -> Violation:
    """Returns why no posture has the tool at a position (3,): its distance, or the joint limits."""
    distance = float(np.linalg.norm(p_W - problem.cell.X_WB[:3, 3]))
    reach = farthest_reach(problem)
    if distance > reach:
        return Violation("reach", distance, reach, "m", detail="distance from the arm's base")
    detail = f"no posture was found that brings the tool there, in {MORE_ORIENTATIONS} orientations of it,"
    return nothing_found("joint_position", f"{detail} within what the joints reach and away from singularities")


def farthest_reach(problem: ThrowProblem) -> float:
    """Returns an upper bound on the tool centre's distance from the base [m]: the sum of all link lengths."""
    robot = problem.cell.robot
    return float(np.hypot(robot.a, robot.d).sum() + np.linalg.norm(problem.cell.tool.X_FT[:3, 3]))
