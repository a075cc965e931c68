"""Arm and tool as capsules: all points within a radius of a segment.

The arm has twelve: the foot, a housing around each joint axis, the two tubes, and the tubes' collars. A housing is
round about its joint's axis, so the joint turns it into itself: it is given in the frame before the joint, which fewer
joints move. They contain the arm's meshes, from which a program makes them; picture: docs/collision-geometry.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, read_only
from planner.cell import ToolCapsule
from planner.kinematics import link_poses
from planner.robots import Robot, ShapeSource, capsule_rows
from planner.robots import robot as known_robot

AXIS_TOLERANCE_M = 1e-9  # [m] rounding: a capsule this close to an axis is round about it
TUBES = ("upper_arm", "forearm")


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within a radius of a segment.

    Attributes:
        frame: DH frame it is fixed in; 0 is the base, 6 the flange.
        p0, p1: ends of the segment in that frame (3,) [m].
        radius_m: its radius [m].
        name: of the part of the arm.
    """

    frame: int
    p0: Array
    p1: Array
    radius_m: float
    name: str

    @property
    def reach_m(self) -> float:
        """Largest distance of the segment from the frame's origin [m]."""
        return max(float(np.linalg.norm(self.p0)), float(np.linalg.norm(self.p1)))

    @property
    def is_round_about_z(self) -> bool:
        """Whether its axis is the z axis of its frame, about which the next joint turns."""
        return bool(max(np.hypot(*self.p0[:2]), np.hypot(*self.p1[:2])) < AXIS_TOLERANCE_M)


@cache
def arm_capsules(robot: Robot) -> tuple[Capsule, ...]:
    """Returns the capsules of an arm, from the base outwards; in the frames of a calibrated arm they are the same."""
    measured = tuple(
        Capsule(row["frame"], read_only(row["from_m"]), read_only(row["to_m"]), row["radius_m"], name)
        for name, row in capsule_rows(robot.shape.of).items()
    )
    return _at_lengths(measured, robot.published, robot.shape) if robot.shape.is_estimate else measured


def _at_lengths(capsules: Sequence[Capsule], robot: Robot, shape: ShapeSource) -> tuple[Capsule, ...]:
    """Returns the capsules of one arm as an estimate of those of another: as thick, at the other's lengths.

    Each coordinate of an end moves with what it is nearest to: an axis, the end of a link, or a tube. Where a tube of
    other length is thin nobody knows: it is as thick as its collars, up to the one at its start.

    Args:
        capsules: of the measured arm.
        robot: the other arm.
        shape: where its capsules are from.
    """
    assert shape.tubes_m is not None
    z_of = {capsule.name: float(capsule.p0[2]) for capsule in capsules}
    before = _landmarks(known_robot(shape.of), (z_of["upper_arm"], z_of["forearm"]))
    after = _landmarks(robot, shape.tubes_m)
    thick_m = {tube: max(c.radius_m for c in capsules if c.name.startswith(tube)) for tube in TUBES}
    if shape.foot_radius_m is not None:
        thick_m["foot"] = shape.foot_radius_m

    def moved(frame: int, p: Array) -> Array:
        return read_only([_moved(x, *marks) for x, *marks in zip(p, before[frame], after[frame], strict=True)])

    until = {tube: next(c.p0 for c in capsules if c.name == f"{tube}_start") for tube in TUBES}
    return tuple(
        replace(
            c,
            p0=moved(c.frame, c.p0),
            p1=moved(c.frame, until.get(c.name, c.p1)),
            radius_m=thick_m.get(c.name, c.radius_m),
        )
        for c in capsules
    )


def _landmarks(robot: Robot, tubes_m: tuple[float, float]) -> list[tuple[list[float], ...]]:
    """Returns, for each frame with capsules, places along its x, y and z that capsules end at or near [m]."""
    upper, fore = tubes_m
    upper_m, fore_m = (-robot.a[1:3]).tolist()
    d1, _, _, d4, d5, d6 = robot.d.tolist()
    none = [0.0]
    return [
        (none, none, [0.0, d1]),
        (none, none, [0.0, upper]),
        ([0.0, upper_m], none, [fore, upper]),
        ([0.0, fore_m], none, [fore, d4]),
        (none, none, [0.0, d5]),
        (none, none, [0.0, d6]),
    ]


def _moved(x: float, before: Sequence[float], after: Sequence[float]) -> float:
    nearest = int(np.argmin(np.abs(np.subtract(before, x))))
    return float(x + after[nearest] - before[nearest])


def body_capsules(robot: Robot, tool: Sequence[ToolCapsule]) -> tuple[Capsule, ...]:
    """Returns the capsules of arm and tool; the tool's come last and are named `tool_0`, `tool_1`, …"""
    of_tool = (Capsule(6, read_only(c.from_m), read_only(c.to_m), c.radius_m, f"tool_{i}") for i, c in enumerate(tool))
    return (*arm_capsules(robot), *of_tool)


def capsule_endpoints(robot: Robot, capsules: Sequence[Capsule], q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Returns the ends (..., n, 2, 3) [m] of n capsules at joint positions `q` (..., 6) [rad].

    They are in the world, or in the base where `X_WB` is None.
    """
    X = link_poses(robot, q)
    if X_WB is not None:
        X = np.asarray(X_WB, dtype=np.float64) @ X
    X = X[..., [c.frame for c in capsules], :, :]
    local = np.array([[c.p0, c.p1] for c in capsules])
    return local @ np.swapaxes(X[..., :3, :3], -1, -2) + X[..., None, :3, 3]


def levers(robot: Robot, frame: int, reach_m: float) -> Array:
    """Returns upper bounds on the distances (6,) [m] of a point from the joint axes; they fall towards the tool.

    The offset d of a joint's own link lies along its axis and does not count. Joints that do not move the point have
    a lever of 0.

    Args:
        robot: the arm.
        frame: DH frame in which the point is fixed.
        reach_m: largest distance of the point from that frame's origin [m].
    """
    own = np.abs(robot.a)
    beyond = np.hypot(robot.a, robot.d)
    lever = np.zeros(6)
    for j in range(frame):
        lever[j] = own[j] + beyond[j + 1 : frame].sum() + reach_m
    return np.maximum.accumulate(lever[::-1])[::-1]  # rounding alone could make them grow
