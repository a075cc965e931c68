"""The chain of a calibrated arm: six fixed transforms M_i, so that X_BF = Rz(q1) M_1 Rz(q2) M_2 ... Rz(q6) M_6.

Six poses describe more than the chain has: frame i may slide along the axis of joint i+1 and turn about it, as both
commute with that joint's rotation. Each frame is placed on its axis as close as possible to where the published table
puts it, so that everything given in these frames, capsules and masses, stays where it was.

That also removes the large offsets of measured tables. The axes of joints 2, 3 and 4 are parallel but for milliradians,
and two such axes have their common normal, on which Denavit and Hartenberg put the frame, up to hundreds of metres
away: d2, d3 and d4 are large and cancel. Source: Hayati and Mirmirani 1985, on tables for nearly parallel axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from planner.arrays import Array, read_only
from planner.calibration.dh_table import DhTable, published_table, row_transform, turn_z
from planner.robots import Robot
from planner.rotations import angle_between, invert_pose

# [m] largest offset of a frame from where the published table puts it, seen from the one before. Deviations of 5 mm
# in three links add up along parallel axes; the closest two models, UR3 and UR3e, are 18.7 mm apart (d4).
PLAUSIBLE_M = 0.018
PLAUSIBLE_RAD = 0.05  # [rad] largest turn of it; measured arms have some milliradians
COINCIDENT = 1e-9  # [m, rad] within which the first joint's axis is the z axis of the base
CHAINS_KEPT = 64  # calibrated arms that are kept, so that equal ones are one object and share all caches


class ImplausibleChain(ValueError):
    """A chain is not that of an arm of the given model."""


def transforms_of_table(table: DhTable) -> Array:
    """Returns the fixed transforms (6, 4, 4) of a table: Rz(theta) Tz(d) Tx(a) Rx(alpha)."""
    return np.array([row_transform(*row) for row in table.rows])


def transforms_of_links(links: Sequence[Array], flange: Array) -> Array:
    """Returns the fixed transforms (6, 4, 4) of a chain given as in URDF: each joint turns about z after its link.

    Args:
        links: pose (4, 4) of each joint in the link before it, the first in the base.
        flange: pose (4, 4) of the flange in the last link.

    Raises:
        ImplausibleChain: the first joint does not turn about the z axis of the base.
    """
    first = links[0]
    if max(abs(first[0, 3]), abs(first[1, 3]), abs(first[0, 2]), abs(first[1, 2])) > COINCIDENT:
        raise ImplausibleChain(
            "the first joint's axis is not the z axis of the base, as in every controller's own table; "
            "where the base stands belongs to [base_in_world]"
        )
    return np.array([_screw(first) @ links[1], *links[2:], flange])


def fixed_transforms(robot: Robot) -> Array:
    """Returns the fixed transforms (6, 4, 4) of an arm, calibrated or not."""
    return transforms_of_table(published_table(robot)) if robot.fixed is None else robot.fixed


def calibrated(robot: Robot, transforms: Array) -> Robot:
    """Returns the arm with a measured chain; equal chains give the same object.

    Its lengths `a` and `d` are those of the measured chain: distances between axes and along them, so that every bound
    made of them holds for it.

    Args:
        robot: the published arm.
        transforms: fixed transforms of its chain (6, 4, 4), with frames anywhere on their axes.

    Raises:
        ImplausibleChain: a link deviates from the published one by more than an arm's tolerances.
    """
    return _calibrated(robot, np.ascontiguousarray(transforms, dtype=np.float64).tobytes())


@lru_cache(maxsize=CHAINS_KEPT)
def _calibrated(robot: Robot, transforms: bytes) -> Robot:
    fixed = _placed(np.frombuffer(transforms).reshape(6, 4, 4), robot)
    across = np.hypot(fixed[:, 0, 3], fixed[:, 1, 3])
    return replace(
        robot,
        a=read_only(np.where(robot.a < 0.0, -across, across)),
        d=read_only(fixed[:, 2, 3]),
        fixed=read_only(fixed),
    )


def _placed(transforms: Array, robot: Robot) -> Array:
    """Returns the same chain with each frame on its axis where the published table would put it."""
    published = transforms_of_table(published_table(robot))
    placed = np.empty((6, 4, 4))
    rest = np.eye(4)
    for i in range(5):
        measured = rest @ transforms[i]
        placed[i] = _closest_on_axis(measured, published[i])
        rest = _screw(invert_pose(placed[i]) @ measured)
        _require_plausible(placed[i], published[i], robot.joint_names[i + 1])
    placed[5] = rest @ transforms[5]
    _require_plausible(placed[5], published[5], "flange")
    return placed


def _closest_on_axis(measured: Array, published: Array) -> Array:
    """Returns the pose (4, 4) closest to `published` whose z axis is that of `measured`, as a line."""
    axis = measured[:3, 2]
    point = measured[:3, 3]
    x = published[:3, 0] - axis * (axis @ published[:3, 0])
    x = x / max(float(np.linalg.norm(x)), np.finfo(np.float64).tiny)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(axis, x), axis])
    X[:3, 3] = point + axis * (axis @ (published[:3, 3] - point))
    return X


def _screw(X: Array) -> Array:
    """Returns a motion about and along z without the rounding of its other components."""
    screw = turn_z(float(np.arctan2(X[1, 0], X[0, 0])))
    screw[2, 3] = X[2, 3]
    return screw


def _require_plausible(placed: Array, published: Array, name: str) -> None:
    offset = float(np.linalg.norm(placed[:3, 3] - published[:3, 3]))
    turn = angle_between(placed[:3, :3], published[:3, :3])
    if not offset <= PLAUSIBLE_M:
        reason = f"{offset * 1e3:.1f} mm from where the published table puts it, more than {PLAUSIBLE_M * 1e3:g} mm"
    elif not turn <= PLAUSIBLE_RAD:
        reason = f"turned by {turn:.3g} rad against the published table, more than {PLAUSIBLE_RAD:g} rad"
    else:
        return
    raise ImplausibleChain(f"{name} is {reason}: the file is of another model")
