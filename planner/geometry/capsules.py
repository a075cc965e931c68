"""Arm and tool as capsules: all points within a radius of a segment.

The arm is nine of them: the foot, a housing around each joint axis, and the two tubes between. A housing is round
about its axis, so it belongs to the link before as well as to the link behind that joint; here it is in the earlier
frame, which fewer joints move. A picture is in docs/collision-geometry.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.cell import ToolCapsule
from planner.kinematics.chain import link_poses
from planner.robots import Robot

Array = NDArray[np.float64]

FOOT_HEIGHT_M = 0.02  # source: base plates of the arms, 10 to 20 mm thick in the manuals' drawings


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius_m` of the segment p0-p1, given in a DH frame of the arm.

    `frame` 0 is the base, 6 the flange; `p0` and `p1` (3,) in that frame [m].
    """

    frame: int
    p0: Array
    p1: Array
    radius_m: float
    name: str


@cache
def arm_capsules(robot: Robot) -> tuple[Capsule, ...]:
    """The nine capsules of the arm, from the base out."""
    # A housing runs a third (shoulder, elbow) or half (wrists) of its radius beyond the crossing of two tubes.
    # source: MuJoCo Menagerie's capsules of UR5e and UR10e, 0.02 m at radii of 0.06 m and 0.04 m
    s, upper, fore = robot.shape, -robot.a[1], -robot.a[2]
    d1, d4, d5, d6 = robot.d[0], robot.d[3], robot.d[4], robot.d[5]
    shoulder_cap, elbow_cap, wrist_cap = s.shoulder_radius / 3.0, s.elbow_radius / 3.0, s.wrist_radius / 2.0
    elbow_start = s.elbow_offset + s.elbow_radius - s.forearm_radius  # its round end is flush with the forearm
    rows = (
        ("foot", 0, (0, 0, 0), (0, 0, FOOT_HEIGHT_M), s.base_radius),
        ("base", 0, (0, 0, 0), (0, 0, d1 + shoulder_cap), s.shoulder_radius),
        ("shoulder", 1, (0, 0, 0), (0, 0, s.shoulder_offset + shoulder_cap), s.shoulder_radius),
        ("upper_arm", 2, (upper, 0, s.shoulder_offset), (0, 0, s.shoulder_offset), s.upper_arm_radius),
        ("elbow", 2, (0, 0, elbow_start), (0, 0, s.shoulder_offset + elbow_cap), s.elbow_radius),
        ("forearm", 3, (fore, 0, s.elbow_offset), (0, 0, s.elbow_offset), s.forearm_radius),
        ("wrist_1", 3, (0, 0, s.elbow_offset - wrist_cap), (0, 0, d4), s.wrist_radius),
        ("wrist_2", 4, (0, 0, -wrist_cap), (0, 0, d5), s.wrist_radius),
        ("wrist_3", 5, (0, 0, -wrist_cap), (0, 0, d6 - wrist_cap), s.wrist_radius),
    )
    return tuple(Capsule(frame, _fixed(p0), _fixed(p1), radius, name) for name, frame, p0, p1, radius in rows)


def body_capsules(robot: Robot, tool: Sequence[ToolCapsule]) -> tuple[Capsule, ...]:
    """Arm and tool, the tool's last and named `tool_0`, `tool_1`, …"""
    hung = (Capsule(6, _fixed(c.from_m), _fixed(c.to_m), c.radius_m, f"tool_{i}") for i, c in enumerate(tool))
    return (*arm_capsules(robot), *hung)


def capsule_endpoints(robot: Robot, capsules: Sequence[Capsule], q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Ends (..., n, 2, 3) [m] of n capsules in the world, or in the base where `X_WB` is None; q is (..., 6) [rad]."""
    X = link_poses(robot, q)
    if X_WB is not None:
        X = np.asarray(X_WB, dtype=np.float64) @ X
    X = X[..., [c.frame for c in capsules], :, :]
    local = np.array([[c.p0, c.p1] for c in capsules])
    return local @ np.swapaxes(X[..., :3, :3], -1, -2) + X[..., None, :3, 3]


def _fixed(point: Any) -> Array:
    array = np.array(point, dtype=np.float64)
    array.setflags(write=False)
    return array
