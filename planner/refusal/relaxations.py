"""What a release may relax: releases from an easy one to the requested one, the mildest relaxation first.

Each relaxation is a function of a share: 0 is easy, 1 is as requested, or as close to it as the arm can be asked.

    a state   slower; of a tool from the closest places where some posture has the velocity; towards the start at rest
    a target  past what is in its way; from a target that is easy to hit; the same from any release position
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np

from planner.arrays import Array, Mask, read_only
from planner.geometry import ToolState, body_model, tool_pose, twist_in_base
from planner.kinematics import inverse_branches, inverse_velocity, jacobian, singularity_distances
from planner.problem import ThrowProblem
from planner.releases import PointState, Release, Target
from planner.releases.release import between
from planner.rotations import invert_pose
from planner.seeds import SPREAD_RAD, allocate_velocity, farthest_reach, tool_jacobian

Relaxation = Callable[[float], Release]

SHARE_MIN = 0.02  # [-] of the requested speed or displacement that is still a throw
SPEEDS = (1.0, 0.3, 0.05)  # [-] of the requested one, for which other places are looked for in turn
POSTURES = 1536  # [-] drawn for a point
AZIMUTHS = 24
RADII = 10
HEIGHTS = 6  # [-] of the grid of places tried for a pose
RADIUS_SHARES = (0.2, 0.95)
HEIGHT_SHARES = (-0.3, 0.8)  # [-] of the reach: extent of that grid
CHECKED_MAX = 200  # [-] closest places that are checked for clearance
CLEARANCE_M = 0.03  # [m] beyond every required clearance, as room for launch and brake
ASIDE_M = 0.2  # [m] from a target, past what is in its way
UNDER_M = 0.2  # [m] from below the tool at the start, towards the target: an easy throw
COMFORTABLE_REACH = 0.6  # [-] of the arm's reach: places there have many postures
STEPS_OUT = 24
NEAREST_OUT = 8  # [-] distances tried from the base to there; those from a third of it on are targets
BESIDE_M = 0.05  # [m] between the object and a shape that an easy target is in front of
TINY_M = 1e-6  # [m] keeps lengths away from zero


def relaxations(problem: ThrowProblem) -> Iterator[Relaxation]:
    """Yields the relaxations of a problem's release, the mildest first."""
    if problem.target is None:
        yield from state_relaxations(problem)
    else:
        yield from target_relaxations(problem, problem.target)


def state_relaxations(problem: ThrowProblem) -> Iterator[Relaxation]:
    """Yields a slower release, others from feasible places, then one drawn towards a standstill at the start.

    The closest place at the requested velocity comes first, then those at less of it. Given joints have no other place.
    """
    release = problem.release
    if not problem.ends_at_rest:
        yield lambda share: release.slower(_at_least(share))
    tool = release.tool_state or release.point_state
    if tool is not None:
        farthest = within(problem.cell.X_WB[:3, 3], tool.p_WT, farthest_reach(problem))
        for speed in SPEEDS:
            slowed = release.slower(speed)
            closest = _closest_place(problem, slowed)
            if closest is not None:
                yield partial(_moved_between, slowed, closest, farthest)
    X_W0 = tool_pose(problem.cell, problem.start)
    yield lambda share: release.slower(_at_least(share)).towards(problem.start, X_W0, _at_least(share))


def target_relaxations(problem: ThrowProblem, target: Target) -> Iterator[Relaxation]:
    """Yields nearer targets: past what is in the way, from easy ones, and the same without a release position.

    A target below the floor is lifted onto it.
    """
    x, y, z = target.p_W
    target = replace(target, p_W=np.array([x, y, max(z, problem.cell.surroundings.floor_z_m)]))
    farthest = _farthest_throw(problem, target)
    tool = tool_pose(problem.cell, problem.start)[:3, 3]
    under = np.array([*within(tool[:2], target.p_W[:2], UNDER_M), target.p_W[2]])
    comfortable = [_comfortable_target(problem, towards, target.p_W[2]) for towards in (target.p_W, tool)]
    targets = [target] if target.release_position is None else [target, replace(target, release_position=None)]
    for requested in targets:
        for easy in (*_aside(problem, target.p_W), *comfortable, under):
            yield partial(_target_between, problem.release.with_target(requested), easy, farthest)


def _aside(problem: ThrowProblem, p_W: Array) -> Iterator[Array]:
    """Yields places (3,) past the shapes that may be in a target's way: on top of, below, beside and behind them."""
    shapes = problem.cell.surroundings.keep_out
    tops = [shape.upper[2] for shape in shapes if shape.depth(p_W) >= 0.0]
    yield from (np.array([*p_W[:2], top]) for top in tops if top - p_W[2] <= ASIDE_M)
    if not shapes:
        return
    lowest = max(p_W[2] - ASIDE_M, problem.cell.surroundings.floor_z_m)
    if lowest < p_W[2]:
        yield np.array([*p_W[:2], lowest])
    away = p_W[:2] - problem.cell.X_WB[:2, 3]
    length = float(np.linalg.norm(away))
    if length > TINY_M:
        ahead = np.array([*away, 0.0]) / length
        across = np.array([-ahead[1], ahead[0], 0.0])
        yield from (p_W + ASIDE_M * direction for direction in (across, -across, ahead))


def _at_least(share: float) -> float:
    return max(share, SHARE_MIN)


def _moved_between(release: Release, near: Array, far: Array, share: float) -> Release:
    return release.moved_to(between(near, far, share))


def _closest_place(problem: ThrowProblem, release: Release) -> Array | None:
    """Returns the closest place (3,) where a posture has the release's velocity and room to move; None without any."""
    if release.tool_state is not None:
        place = release.tool_state.p_WT
        q, p = _pose_postures(problem, release.tool_state)
    else:
        assert release.point_state is not None
        place = release.point_state.p_WT
        q, p = _point_postures(problem, release.point_state)
    order = np.argsort(np.linalg.norm(p - place, axis=1), kind="stable")[:CHECKED_MAX]
    clear = body_model(problem.cell_with_bin).clearances(q[order]).least >= CLEARANCE_M
    return p[order[clear.argmax()]] if clear.any() else None


def _point_postures(problem: ThrowProblem, point: PointState) -> tuple[Array, Array]:
    """Returns drawn postures (n, 6) that can have the velocity, and their tool positions (n, 3)."""
    cell = problem.cell
    limits = problem.reachable
    q = np.clip(problem.start + _offsets() * SPREAD_RAD, limits.q_lower, limits.q_upper)
    q = q[_regular(problem, q)]
    qd = allocate_velocity(tool_jacobian(problem, q), cell.X_WB[:3, :3].T @ point.v_WT, limits.qd_max)
    q = q[_within_speed(problem, qd)]
    return q, tool_pose(cell, q)[:, :3, 3]


def _pose_postures(problem: ThrowProblem, tool: ToolState) -> tuple[Array, Array]:
    """Returns postures (n, 6) in the requested orientation that can have the twist, and their tool positions (n, 3)."""
    cell = problem.cell
    limits = problem.reachable
    grid = _position_grid(problem, tool.p_WT)
    X_WT = np.tile(tool.X_WT, (len(grid), 1, 1))
    X_WT[:, :3, 3] = grid
    q, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    p = np.repeat(grid, q.shape[1], axis=0)
    q = q.reshape(-1, 6)
    good = np.isfinite(q[:, 0])
    q = q[good]
    p = p[good]
    good = np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1) & _regular(problem, q)
    q = q[good]
    p = p[good]
    V_BT = twist_in_base(cell, tool.V_WT)
    good = _within_speed(problem, inverse_velocity(jacobian(cell.robot, q, cell.tool.X_FT), V_BT))
    return q[good], p[good]


def _position_grid(problem: ThrowProblem, p_W: Array) -> Array:
    """Returns positions (n, 3) on a cylindrical grid around the base; one azimuth is that of `p_W` (3,)."""
    reach = farthest_reach(problem)
    base = problem.cell.X_WB[:3, 3]
    away = p_W - base
    angle = np.arctan2(away[1], away[0]) + np.linspace(-np.pi, np.pi, AZIMUTHS, endpoint=False)
    radius = np.linspace(*RADIUS_SHARES, RADII) * reach
    height = np.linspace(*HEIGHT_SHARES, HEIGHTS) * reach
    angle, radius, height = (x.ravel() for x in np.meshgrid(angle, radius, height))
    return base + np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _regular(problem: ThrowProblem, q: Array) -> Mask:
    """Returns the mask of the postures (n, 6) that keep the required distance from singularities."""
    return singularity_distances(problem.cell.robot, q).minimum >= problem.limits.singularity_distance_min


def _within_speed(problem: ThrowProblem, qd: Array) -> Mask:
    """Returns the mask of the joint velocities (n, 6) within the speed limits."""
    return np.all(np.abs(qd) <= problem.limits.qd_max, axis=1)


@cache
def _offsets() -> Array:
    """Returns random points (POSTURES, 6) in [-1, 1], the same at every call."""
    return read_only(np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, 6)))


def _target_between(release: Release, near: Array, far: Array, share: float) -> Release:
    assert release.target is not None
    return release.with_target(replace(release.target, p_W=between(near, far, share)))


def _comfortable_target(problem: ThrowProblem, direction: Array, height: float) -> Array:
    """Returns a target (3,) well within reach, in the direction of a position (3,), at a height [m] if reachable.

    It is in front of the first keep-out shape on the way, if that leaves room.
    """
    cell = problem.cell
    base = cell.X_WB[:3, 3]
    reach = COMFORTABLE_REACH * farthest_reach(problem)
    away = direction[:2] - base[:2]
    length = float(np.linalg.norm(away))
    along = away / length if length > TINY_M else np.array([1.0, 0.0])
    z = min(height, base[2] + cell.robot.d[0] + reach)
    distance = np.linspace(0.0, reach, STEPS_OUT + 1)[:, None]
    p = np.column_stack([base[:2] + distance * along, np.full(len(distance), z)])
    return p[_unblocked(problem, p)]


def _unblocked(problem: ThrowProblem, p: Array) -> int:
    """Returns the row of `p` (n, 3) before the first one from `NEAREST_OUT` on that a shape blocks, or the last."""
    room = problem.cell.object.radius_m + BESIDE_M
    blocked = np.zeros(len(p), dtype=bool)
    for shape in problem.cell.surroundings.keep_out:
        blocked |= np.all((p >= shape.lower - room) & (p <= shape.upper + room), axis=1)
    ahead = np.flatnonzero(blocked[NEAREST_OUT:])
    return NEAREST_OUT + int(ahead[0]) - 1 if len(ahead) and ahead[0] else len(p) - 1


def _farthest_throw(problem: ThrowProblem, target: Target) -> Array:
    """Returns the target (3,), or the farthest position on the way to it that a throw within the speed limits reaches.

    Source: range of a throw from height h at speed v, v/g sqrt(v^2 + 2 g h).
    """
    base = problem.cell.X_WB[:3, 3]
    reach = farthest_reach(problem)
    g = problem.gravity_at_tool_speed
    v = min(problem.limits.tcp_speed_max, target.max_speed_m_s)
    height = max(base[2] + reach - target.p_W[2], 0.0)
    near = np.array([*base[:2], target.p_W[2]])
    return within(near, target.p_W, reach + v / g * np.sqrt(v * v + 2.0 * g * height))


def within(centre: Array, p: Array, radius: float) -> Array:
    """Returns `p`, or the closest position to it within a radius of the centre."""
    distance = float(np.linalg.norm(p - centre))
    return p if distance <= radius else centre + (p - centre) * radius / distance
