"""Which capsules of arm and tool can meet: derived from the geometry, once for each arm and tool.

A pair is left out only where one of two things is certain: the two are always nearer than the clearance (neighbours
that share a joint), or they never are. Both are decided on a grid over the joints between the two, together with how
far the capsules move from a point of the grid to the next. Where the grid cannot decide, the pair is kept: that costs
time, not safety.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from planner.cell import ToolCapsule
from planner.geometry.capsules import Capsule, body_capsules, capsule_endpoints
from planner.geometry.distances import segment_segment_distance
from planner.robots import Robot

Array = NDArray[np.float64]
Packed = tuple[tuple[float, ...], ...]

# [m] kept between capsules of arm and tool: the capsules already enclose the links, this is for bending and rounding
SELF_CLEARANCE_M = 0.005

# Points of the grid on each joint, by how many joints there are: a first look that most often shows a pair both near
# and far, and one fine enough to prove the rest.
GRID_POINTS = {1: (64, 1024), 2: (16, 144)}
AXIS_TOLERANCE_M = 1e-9  # a capsule this near to a joint's axis is round about it


def self_collision_pairs(robot: Robot, tool: Sequence[ToolCapsule]) -> tuple[tuple[int, int], ...]:
    """Pairs of indices into `body_capsules(robot, tool)` that can meet and do not always."""
    return _pairs(robot, packed(tool))


def packed(tool: Sequence[ToolCapsule]) -> Packed:
    """Returns the tool's numbers, by which results can be remembered."""
    return tuple((*c.from_m.tolist(), *c.to_m.tolist(), c.radius_m) for c in tool)


def unpacked(tool: Packed) -> list[ToolCapsule]:
    """Returns the tool of `packed` numbers."""
    return [ToolCapsule(np.array(c[:3]), np.array(c[3:6]), c[6]) for c in tool]


@lru_cache(maxsize=256)
def _pairs(robot: Robot, tool: Packed) -> tuple[tuple[int, int], ...]:
    capsules = body_capsules(robot, unpacked(tool))
    indices = combinations(range(len(capsules)), 2)
    return tuple((i, j) for i, j in indices if _can_meet(robot, capsules[i], capsules[j]))


def distances_by_joint(robot: Robot, first: Capsule, second: Capsule, step: float) -> tuple[int, Array, Array]:
    """Returns the one joint that moves two bodies to one another, positions of it, and the bodies' distances there.

    The positions (k,) [rad] are at most `step` apart and span the joint's limits; none where more joints do.
    """
    near, far = sorted((first, second), key=lambda c: c.frame)
    joints = _joints_between(near, far)
    if far.frame == len(robot.a) and _off_axis(far) < AXIS_TOLERANCE_M:
        joints = joints[:-1]  # a tool round about the last axis turns in itself
    if len(joints) != 1:
        return -1, np.empty(0), np.empty(0)
    joint = joints[0]
    lower, upper = robot.q_lower[joint], robot.q_upper[joint]
    q = np.zeros((int(np.ceil((upper - lower) / step)) + 1, 6))
    q[:, joint] = np.linspace(lower, upper, len(q))
    return joint, q[:, joint], _distances(robot, near, far, q)


def _can_meet(robot: Robot, first: Capsule, second: Capsule) -> bool:
    near, far = sorted((first, second), key=lambda c: c.frame)
    joints = _joints_between(near, far)
    if len(joints) not in GRID_POINTS:
        return len(joints) > 0
    coarse, fine = GRID_POINTS[len(joints)]
    distance, _ = _distances_on_grid(robot, near, far, joints, coarse)
    if distance.min() < SELF_CLEARANCE_M <= distance.max():
        return True
    distance, step = _distances_on_grid(robot, near, far, joints, fine)
    always = distance.max() < SELF_CLEARANCE_M
    never = distance.min() - 0.5 * step @ _levers(robot, near, far, joints) > SELF_CLEARANCE_M
    return not (always or never)


def _joints_between(near: Capsule, far: Capsule) -> list[int]:
    """Joints that change how the two lie to each other; the first does not if `near` is round about its axis."""
    joints = list(range(near.frame, far.frame))
    return joints[1:] if _off_axis(near) < AXIS_TOLERANCE_M else joints


def _off_axis(capsule: Capsule) -> float:
    return float(max(np.hypot(*capsule.p0[:2]), np.hypot(*capsule.p1[:2])))


def _distances_on_grid(robot: Robot, near: Capsule, far: Capsule, joints: list[int], count: int) -> tuple[Array, Array]:
    """Surface distances on a grid over the limits of these joints, and the steps of the grid [rad]."""
    lower = robot.q_lower[joints]
    upper = np.minimum(robot.q_upper[joints], lower + 2.0 * np.pi)  # more than a turn shows nothing new
    axes = np.linspace(lower, upper, count).T
    q = np.zeros((count ** len(joints), 6))
    q[:, joints] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    return _distances(robot, near, far, q), (upper - lower) / (count - 1)


def _distances(robot: Robot, near: Capsule, far: Capsule, q: Array) -> Array:
    """Surface distances (k,) [m] at joint positions q (k, 6)."""
    ends = capsule_endpoints(robot, (near, far), q)
    gap = segment_segment_distance(ends[:, 0, 0], ends[:, 0, 1], ends[:, 1, 0], ends[:, 1, 1])
    return gap - near.radius_m - far.radius_m


def _levers(robot: Robot, near: Capsule, far: Capsule, joints: list[int]) -> Array:
    """For each of the joints, how far a point of `far` is from its axis at most [m]."""
    tip = max(float(np.linalg.norm(far.p0)), float(np.linalg.norm(far.p1)))
    beyond = np.hypot(robot.a, robot.d)
    return np.array([abs(robot.a[j]) + beyond[j + 1 : far.frame].sum() + tip for j in joints])
