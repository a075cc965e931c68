"""Self-collision of arm and tool, derived from the geometry once for each arm and tool.

Pairs: which capsules can collide. One is left out only if it is proven that the two are never closer than the
clearance, or that they always are because they are neighbours: two parts of the arm, or a part that the tool or the
object keeps its distance from in every posture. Both are decided on a grid over the joints between the two, with a
bound on the motion of the capsules between grid points. Where the grid cannot decide, the pair is kept: that costs
time, not safety. Nor is a pair left out of a tool that is always too close to the arm but not always as close: no
posture is clear then, and no motion is certified.

Barriers: joint positions that no motion can pass. Where one joint alone moves two capsules against each other, the
positions at which they collide divide its range, and a motion stays in the part in which it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Surroundings, ToolCapsule
from planner.geometry.capsules import Capsule, arm_capsules, body_capsules, capsule_endpoints, levers
from planner.geometry.distances import segment_segment_distance
from planner.robots import Robot

ToolKey = tuple[tuple[float, ...], ...]

# [m] kept between capsules of arm and tool: the capsules already enclose the links, this is for bending and rounding
SELF_CLEARANCE_M = 0.005

# Grid points on each joint, by the number of joints: a coarse grid, which most often shows a pair both near and far,
# and one fine enough to prove the rest.
GRID_POINTS = {1: (64, 1024), 2: (16, 144)}
BARRIER_STEP_RAD = np.radians(0.5)  # [rad] between evaluated positions; a narrower barrier is left to the certificate
EDGE_HALVINGS = 20  # [-] of the step in which a barrier begins: that leaves 1e-8 rad
ROUNDING = 1e-6  # [-] of a step
# [m] by which the distance of neighbours changes at most: a tool beside the last axis turns about it
NEIGHBOURS_M = SELF_CLEARANCE_M


@dataclass(frozen=True, eq=False)
class Barrier:
    """Positions of one joint at which two capsules are closer than the self clearance.

    Attributes:
        joint: its index.
        names: of the two capsules.
        q: blocked positions (k,), ascending, at most `BARRIER_STEP_RAD` apart where all between them are [rad]; where
            the barrier begins or ends within the joint's range, its edges are among them.
        distance_m: smallest distance of the two [m].
    """

    joint: int
    names: tuple[str, str]
    q: Array
    distance_m: float


class NeverClear(NamedTuple):
    """Two capsules that no posture brings farther apart than `most_m` [m], which is below the self clearance."""

    names: tuple[str, str]
    most_m: float


def self_collision_pairs(robot: Robot, tool: Sequence[ToolCapsule]) -> tuple[tuple[int, int], ...]:
    """Returns pairs of indices into `body_capsules(robot, tool)` that can collide; no neighbours."""
    return _pairs(robot, _tool_key(tool))


def object_pairs(robot: Robot, tool: Sequence[ToolCapsule], held: Capsule) -> tuple[tuple[int, int], ...]:
    """Returns pairs of indices of the links that the held object can meet, and of the object behind the tool.

    Left out are the tool, and the links beside which it is gripped: they are always as close to it, or never close.

    Args:
        robot: the arm.
        tool: its capsules.
        held: the object, in the flange frame.
    """
    last = len(body_capsules(robot, tool))
    return tuple((i, last) for i in _links_met(robot, (*held.p0.tolist(), *held.p1.tolist(), held.radius_m)))


def pierced(robot: Robot, held: Capsule, around: Surroundings) -> list[NeverClear]:
    """Returns the arm's links that the object is too close to in every posture, with the names of both.

    The tool is not looked at: it holds the object.

    Args:
        robot: the arm.
        held: the object, in the flange frame.
        around: whose pairs may touch.
    """
    found = []
    for link in arm_capsules(robot):
        if around.is_free_to_touch(link.name, held.name):
            continue
        joints = _joints_between(link, held)
        if len(joints) == 0:
            distance = _distances(robot, link, held, np.zeros((1, 6)))
        elif len(joints) in GRID_POINTS:
            distance, _ = _distances_on_grid(robot, link, held, joints, GRID_POINTS[len(joints)][0])
        else:
            continue
        if distance.max() < SELF_CLEARANCE_M:
            found.append(NeverClear((link.name, held.name), float(distance.max())))
    return found


def barriers(robot: Robot, tool: Sequence[ToolCapsule], around: Surroundings | None = None) -> tuple[Barrier, ...]:
    """Returns the barriers of an arm with a tool; not of parts that may touch in the surroundings, where given."""
    found = _barriers(robot, _tool_key(tool))
    return found if around is None else tuple(each for each in found if not around.is_free_to_touch(*each.names))


def never_clear(robot: Robot, tool: Sequence[ToolCapsule], around: Surroundings | None = None) -> list[NeverClear]:
    """Returns the pairs that a tool leaves no posture in which they keep the self clearance, where they must."""
    capsules = body_capsules(robot, tool)
    found = []
    for i, j in self_collision_pairs(robot, tool):
        if around is not None and around.is_free_to_touch(capsules[i].name, capsules[j].name):
            continue
        near, far = sorted((capsules[i], capsules[j]), key=lambda c: c.frame)
        joints = _joints_between(near, far)
        if len(joints) in GRID_POINTS:
            distance, _ = _distances_on_grid(robot, near, far, joints, GRID_POINTS[len(joints)][0])
            if distance.max() < SELF_CLEARANCE_M:
                found.append(NeverClear((near.name, far.name), float(distance.max())))
    return found


def passable(
    robot: Robot, tool: Sequence[ToolCapsule], q: Array, around: Surroundings | None = None
) -> tuple[Array, Array]:
    """Returns the first blocked joint positions below and above `q` (6,), each (6,) [rad]; infinite where none is.

    A barrier that blocks `q` itself is ignored.
    """
    lower = np.full(6, -np.inf)
    upper = np.full(6, np.inf)
    for barrier in barriers(robot, tool, around):
        i = barrier.joint
        here = q[barrier.joint]
        below = barrier.q[barrier.q <= here].max(initial=-np.inf)
        above = barrier.q[barrier.q >= here].min(initial=np.inf)
        if above - below > BARRIER_STEP_RAD * (1.0 + ROUNDING):
            lower[i], upper[i] = max(lower[i], below), min(upper[i], above)
    return lower, upper


def _tool_key(tool: Sequence[ToolCapsule]) -> ToolKey:
    """Returns the tool's capsules as a hashable key, for caches."""
    return tuple((*c.from_m.tolist(), *c.to_m.tolist(), c.radius_m) for c in tool)


def _tool_from_key(key: ToolKey) -> list[ToolCapsule]:
    """Returns the capsules of a `_tool_key`."""
    return [ToolCapsule(np.array(c[:3]), np.array(c[3:6]), c[6]) for c in key]


@lru_cache(maxsize=256)
def _pairs(robot: Robot, tool: ToolKey) -> tuple[tuple[int, int], ...]:
    capsules = body_capsules(robot, _tool_from_key(tool))
    indices = combinations(range(len(capsules)), 2)
    return tuple((i, j) for i, j in indices if _can_collide(robot, capsules[i], capsules[j]))


@lru_cache(maxsize=256)
def _links_met(robot: Robot, held: tuple[float, ...]) -> tuple[int, ...]:
    """Returns the links that an object can meet, by the ends of its capsule in the flange frame and its radius."""
    thing = Capsule(frame=6, p0=np.array(held[:3]), p1=np.array(held[3:6]), radius_m=held[6], name="object")
    return tuple(i for i, link in enumerate(arm_capsules(robot)) if _can_collide(robot, link, thing))


@lru_cache(maxsize=64)
def _barriers(robot: Robot, key: ToolKey) -> tuple[Barrier, ...]:
    tool = _tool_from_key(key)
    capsules = body_capsules(robot, tool)
    found = []
    for i, j in self_collision_pairs(robot, tool):
        near, far = sorted((capsules[i], capsules[j]), key=lambda c: c.frame)
        joint = _only_joint_between(robot, near, far)
        if joint is None:
            continue
        q = _positions_of(robot, joint, BARRIER_STEP_RAD)
        distance = _distances(robot, near, far, q)
        blocked = distance < SELF_CLEARANCE_M
        if blocked.any():
            at = np.concatenate([q[blocked], _edges(robot, near, far, q, blocked)])[:, joint]
            names = (capsules[i].name, capsules[j].name)
            found.append(Barrier(joint, names, np.sort(at), float(distance.min())))
    return tuple(found)


def _edges(robot: Robot, near: Capsule, far: Capsule, q: Array, blocked: Mask) -> Array:
    """Returns blocked joint positions (k, 6) [rad] next to free ones, between neighbours of `q` (n, 6)."""
    first = np.flatnonzero(blocked[1:] != blocked[:-1])
    is_first = blocked[first][:, None]
    inside = np.where(is_first, q[first], q[first + 1])
    outside = np.where(is_first, q[first + 1], q[first])
    for _ in range(EDGE_HALVINGS):
        middle = 0.5 * (inside + outside)
        is_blocked = (_distances(robot, near, far, middle) < SELF_CLEARANCE_M)[:, None]
        inside = np.where(is_blocked, middle, inside)
        outside = np.where(is_blocked, outside, middle)
    return inside


def _only_joint_between(robot: Robot, near: Capsule, far: Capsule) -> int | None:
    """Returns the only joint that moves two capsules against each other, None where there are more, or none."""
    joints = _joints_between(near, far)
    if far.frame == len(robot.a) and far.is_round_about_z:
        joints = joints[:-1]  # the last joint turns a tool that is round about its axis into itself
    return joints[0] if len(joints) == 1 else None


def _positions_of(robot: Robot, joint: int, step: float) -> Array:
    """Returns joint positions (k, 6) [rad] of which one joint's span its limits, `step` apart at most."""
    lower = robot.q_lower[joint]
    upper = robot.q_upper[joint]
    q = np.zeros((int(np.ceil((upper - lower) / step)) + 1, 6))
    q[:, joint] = np.linspace(lower, upper, len(q))
    return q


def _can_collide(robot: Robot, first: Capsule, second: Capsule) -> bool:
    near, far = sorted((first, second), key=lambda c: c.frame)
    joints = _joints_between(near, far)
    if len(joints) not in GRID_POINTS:
        return len(joints) > 0
    coarse, fine = GRID_POINTS[len(joints)]
    distance, _ = _distances_on_grid(robot, near, far, joints, coarse)
    if distance.min() < SELF_CLEARANCE_M <= distance.max():
        return True
    distance, step = _distances_on_grid(robot, near, far, joints, fine)
    always = distance.max() < SELF_CLEARANCE_M and _are_neighbours(robot, far, distance)
    moved = 0.5 * step @ levers(robot, far.frame, far.reach_m)[joints]  # from the nearest point of the grid, at most
    never = distance.min() - moved > SELF_CLEARANCE_M
    return not (always or never)


def _are_neighbours(robot: Robot, far: Capsule, distance: Array) -> bool:
    """Returns whether capsules that are always close to each other are two parts of the arm, or always as close."""
    return far in arm_capsules(robot) or bool(np.ptp(distance) <= NEIGHBOURS_M)


def _joints_between(near: Capsule, far: Capsule) -> list[int]:
    """Returns the joints that change the relative pose; not the first one where `near` is round about its axis."""
    return list(range(near.frame, far.frame))[int(near.is_round_about_z) :]


def _distances_on_grid(robot: Robot, near: Capsule, far: Capsule, joints: list[int], count: int) -> tuple[Array, Array]:
    """Returns distances of the surfaces on a grid over the limits of the joints, and the steps of the grid [rad]."""
    lower = robot.q_lower[joints]
    upper = np.minimum(robot.q_upper[joints], lower + 2.0 * np.pi)  # beyond one turn everything repeats
    axes = np.linspace(lower, upper, count).T
    q = np.zeros((count ** len(joints), 6))
    q[:, joints] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    return _distances(robot, near, far, q), (upper - lower) / (count - 1)


def _distances(robot: Robot, near: Capsule, far: Capsule, q: Array) -> Array:
    """Returns distances of the surfaces (k,) [m] at joint positions `q` (k, 6)."""
    ends = capsule_endpoints(robot, (near, far), q)
    gap = segment_segment_distance(ends[:, 0, 0], ends[:, 0, 1], ends[:, 1, 0], ends[:, 1, 1])
    return gap - near.radius_m - far.radius_m
