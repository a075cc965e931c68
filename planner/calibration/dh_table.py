"""Denavit-Hartenberg tables: what a controller knows of its arm, and how UR's drivers tell arms apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, read_only
from planner.robots import Robot
from planner.rotations import invert_pose

# [1] sine of the angle between two axes below which they count as parallel: their common normal, within 1e10 m of the
# arm at 1e-10, has no place that doubles could hold; a metre of arm makes 1e-10 m of it
PARALLEL = 1e-10


@dataclass(frozen=True, eq=False)
class DhTable:
    """A table in the distal convention, Rz(q + theta) Tz(d) Tx(a) Rx(alpha) for each joint.

    Attributes:
        theta: offsets of the joint positions (6,) [rad].
        a: lengths (6,) [m].
        d: offsets (6,) [m].
        alpha: twists (6,) [rad].
    """

    theta: Array
    a: Array
    d: Array
    alpha: Array

    @property
    def rows(self) -> Iterator[tuple[float, float, float, float]]:
        """The joints' theta, a, d, alpha."""
        return zip(*(x.tolist() for x in (self.theta, self.a, self.d, self.alpha)), strict=True)

    @property
    def hash(self) -> str:
        """The name that UR's drivers give to this calibration.

        Source: `KinematicsInfo::toHash` of UR's client library: GNU's hash of theta, d, a, alpha of each joint, printed
        with six digits. The published hashes of all arms come out.
        """
        text = "".join(f"{x:g}" for theta, a, d, alpha in self.rows for x in (theta, d, a, alpha))
        return f"calib_{gnu_hash(text.encode())}"


def published_table(robot: Robot) -> DhTable:
    """Returns the published table of an arm's model, whether the arm is calibrated or not."""
    model = robot.published
    return DhTable(read_only(np.zeros(6)), model.a, model.d, model.alpha)


def table_of(robot: Robot) -> DhTable:
    """Returns the table of an arm: the published one, or that of its measured chain.

    Raises:
        ValueError: the flange is turned against the last axis in a way that no table holds.
    """
    return published_table(robot) if robot.fixed is None else table_of_transforms(robot.fixed)


def table_of_transforms(fixed: Array) -> DhTable:
    """Returns the table of a chain's fixed transforms (6, 4, 4): frames on the common normals of neighbouring axes.

    Raises:
        ValueError: the flange's x axis is not across the last joint's axis, which no table can express.
    """
    rows = []
    rest = np.eye(4)
    for measured in fixed[:5]:
        X = rest @ measured
        row = _common_normal(X)
        rows.append(row)
        rest = invert_pose(row_transform(*row)) @ X
    X = rest @ fixed[5]
    if abs(X[2, 0]) > 1e-9 or abs(X[:3, 0] @ [-X[1, 3], X[0, 3], 0.0]) > 1e-9:
        raise ValueError("the flange is turned against the last axis: no Denavit-Hartenberg table holds that")
    theta = float(np.arctan2(X[1, 0], X[0, 0]))
    x = X[:3, 0]
    rows.append((theta, float(x @ X[:3, 3]), float(X[2, 3]), float(np.arctan2(X[2, 1], X[2, 2]))))
    return DhTable(*(read_only(column) for column in zip(*rows, strict=True)))


def _common_normal(X: Array) -> tuple[float, float, float, float]:
    """Returns theta, a, d, alpha that bring z onto the z axis of X (4, 4), with theta within a quarter turn."""
    axis = X[:3, 2]
    point = X[:3, 3]
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < PARALLEL:
        normal = np.array([point[0], point[1], 0.0]) if np.hypot(point[0], point[1]) > PARALLEL else X[:3, 0]
        normal = normal / np.linalg.norm(normal)
        normal = normal if normal[0] >= 0.0 else -normal
        return float(np.arctan2(normal[1], normal[0])), float(normal @ point), float(point[2]), 0.0
    normal = np.array([-axis[1], axis[0], 0.0]) / sine
    normal = normal if normal[0] >= 0.0 else -normal
    across = np.array([-normal[1], normal[0], 0.0])  # z x normal
    along = -(across @ point) / (across @ axis)
    twist = float(np.arctan2(-(across @ axis), axis[2]))
    return float(np.arctan2(normal[1], normal[0])), float(normal @ point), float(point[2] + along * axis[2]), twist


def row_transform(theta: float, a: float, d: float, alpha: float) -> Array:
    """Returns Rz(theta) Tz(d) Tx(a) Rx(alpha) (4, 4), exact at quarter turns of alpha, where floats leave 6e-17."""
    c, s = (0.0 if abs(x) < np.finfo(np.float64).eps else x for x in (np.cos(alpha), np.sin(alpha)))
    beyond = np.array([[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, d], [0.0, 0.0, 0.0, 1.0]])
    return turn_z(theta) @ beyond


def turn_z(angle: float) -> Array:
    """Returns the pose (4, 4) of a rotation about z."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def gnu_hash(data: bytes) -> int:
    """Returns std::hash<std::string> of GNU's C++ library on 64 bits: MurmurHash64A with its seed.

    Source: libsupc++/hash_bytes.cc of GCC, after Austin Appleby's MurmurHash2 (public domain).
    """
    mask = 2**64 - 1
    multiplier = 0xC6A4A7935BD1E995
    state = 0xC70F6907 ^ (len(data) * multiplier & mask)
    whole = len(data) - len(data) % 8
    for at in range(0, whole, 8):
        word = int.from_bytes(data[at : at + 8], "little") * multiplier & mask
        word = (word ^ word >> 47) * multiplier & mask
        state = (state ^ word) * multiplier & mask
    if whole < len(data):
        state = (state ^ int.from_bytes(data[whole:], "little")) * multiplier & mask
    state = (state ^ state >> 47) * multiplier & mask
    return state ^ state >> 47
