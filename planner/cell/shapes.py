"""Convex shapes that nothing enters: boxes, cylinders, spheres and capsules, along the world's axes or turned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, read_only
from planner.rotations import pose

SIZES = {  # keys of each shape beyond `shape`, `pose`, `name` and `clearance_m`
    "box": ("size_m",),
    "cylinder": ("radius_m", "length_m"),
    "sphere": ("radius_m",),
    "capsule": ("radius_m", "length_m"),
}
SIZE_MIN_M = 1e-4  # [m] a thinner body is a typing error
ROW = 20  # [-] numbers of `Solid.row`
LEVEL_SINE = 1e-4  # [-] of a top's slope: an object lies on it as on a level one, 0.1 mm a metre lower at most
ALONG_SINE = 1e-12  # [-] rounding: a box that is turned by less lies along the axes of the world
TINY_M = 1e-300  # [m] keeps a distance from an axis away from zero


@dataclass(frozen=True, eq=False)
class Core:
    """What a shape is within a radius of: a box, in the frame of the shape, or an upright cylinder in that box.

    A sphere's core is a box without extent, a capsule's one along z alone.

    Attributes:
        X_WC: pose of the shape's frame in the world (4, 4).
        lower, upper: corners of the box in that frame (3,) [m].
        radius_m: distance of the shape's surface from the core [m]; 0 of boxes and cylinders.
        is_round: whether the core is the largest cylinder about z in the box.
    """

    X_WC: Array
    lower: Array
    upper: Array
    radius_m: float = 0.0
    is_round: bool = False

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Corners (3,) of the box along the world's axes that bounds the shape [m]; the origin is in its middle."""
        R = self.X_WC[:3, :3]
        reach = np.abs(R) @ self.upper
        if self.is_round:
            reach = self.upper[0] * np.hypot(R[:, 0], R[:, 1]) + self.upper[2] * np.abs(R[:, 2])
        centre = self.X_WC[:3, 3]
        return centre - reach - self.radius_m, centre + reach + self.radius_m


class LevelTop(NamedTuple):
    """The outline of a level top: a turned rectangle, or a disc.

    Attributes:
        centre: (2,) [m].
        axes: unit vectors along its sides (2, 2), one a row.
        half: half its sides (2,), or both times the radius of the disc [m].
        is_round: whether it is a disc.
    """

    centre: Array
    axes: Array
    half: Array
    is_round: bool

    def depth(self, x: Array) -> Array:
        """Returns how far within it points (2 or 3, ...) are, horizontally (...) [m]; negative beside it."""
        column = (2, *[1] * (x.ndim - 1))
        along = np.tensordot(self.axes, x[:2] - self.centre.reshape(column), 1)
        if self.is_round:
            return np.asarray(self.half[0] - np.hypot(*along))
        return np.asarray((self.half.reshape(column) - np.abs(along)).min(axis=0))


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body that stands still.

    Attributes:
        lower, upper: corners of the box along the world's axes that bounds it (3,) [m].
        name: what the cell file calls it; empty without a name.
        clearance_m: distance that everything keeps from it [m]; None: the cell's.
        kind: box, cylinder, sphere or capsule.
        core: what it is within a radius of; None of a box along the axes, which its corners tell.
    """

    lower: Array
    upper: Array
    name: str = ""
    clearance_m: float | None = None
    kind: str = "box"
    core: Core | None = None

    def called(self, number: int) -> str:
        """Returns what it is called as the shape of that number: by its name, or by its kind and number."""
        return self.name or f"{self.kind} {number}"

    @cached_property
    def row(self) -> Array:
        """The shape as the kernel takes it (20,): rotation by rows, origin, corners of the core, is round, radius."""
        core = self.core or Core(np.eye(4), self.lower, self.upper)
        X = core.X_WC
        ends = np.concatenate([core.lower, core.upper])
        return read_only([*X[:3, :3].ravel(), *X[:3, 3], *ends, float(core.is_round), core.radius_m])

    @property
    def X_WC(self) -> Array:
        """Pose of its centre and axes in the world (4, 4)."""
        return self.core.X_WC if self.core is not None else pose(0.5 * (self.lower + self.upper), np.eye(3))

    @property
    def extent(self) -> Array:
        """Its extent along its own axes (3,) [m]."""
        lower, upper = (self.lower, self.upper) if self.core is None else (self.core.lower, self.core.upper)
        return upper - lower + 2.0 * self.radius_m

    @property
    def radius_m(self) -> float:
        """Distance of its surface from its core [m]."""
        return 0.0 if self.core is None else self.core.radius_m

    def nearest(self, p: Array) -> Array:
        """Returns the points of the core nearest to points (3, ...) [m]."""
        return nearest_on_cores(p, self.row.reshape(-1, *[1] * (p.ndim - 1)))

    def depth(self, p: Array) -> Array:
        """Returns how deep points (..., 3) lie in the shape [m], negative outside."""
        core = self.core
        if core is None:
            return np.asarray(np.minimum(p - self.lower, self.upper - p).min(axis=-1))
        x = (p - core.X_WC[:3, 3]) @ core.X_WC[:3, :3]
        if core.radius_m > 0.0:
            return np.asarray(core.radius_m - np.linalg.norm(x - np.clip(x, core.lower, core.upper), axis=-1))
        inside = np.minimum(x - core.lower, core.upper - x)
        if core.is_round:
            return np.asarray(np.minimum(core.upper[0] - np.hypot(x[..., 0], x[..., 1]), inside[..., 2]))
        return np.asarray(inside.min(axis=-1))

    @cached_property
    def has_level_top(self) -> bool:
        """Whether an object can lie on it: a box with a level face above, or an upright cylinder."""
        return self.core is None or self.top is not None

    @cached_property
    def top(self) -> LevelTop | None:
        """The outline of a turned or round level top; None without one, and of a box along the axes."""
        core = self.core
        if core is None or core.radius_m > 0.0:
            return None
        R = core.X_WC[:3, :3]
        axis = int(np.abs(R[2]).argmax())
        if np.hypot(R[0, axis], R[1, axis]) > LEVEL_SINE or (core.is_round and axis != 2):
            return None
        across = [i for i in range(3) if i != axis]
        axes = R[:2, across].T / np.linalg.norm(R[:2, across].T, axis=1, keepdims=True)
        return LevelTop(core.X_WC[:2, 3], axes, core.upper[across], core.is_round)


class Box(Solid):
    """A box along the axes of the world: its corners (3,) [m], and a name where it has one."""


def shape_of(kind: str, X_WC: Array, sizes_m: Array, name: str = "", clearance_m: float | None = None) -> Solid:
    """Returns a shape whose centre and axes a pose in the world (4, 4) tells.

    Args:
        kind: box, cylinder, sphere or capsule.
        X_WC: its pose.
        sizes_m: of a box its edges (3,); of the others the radius and the length along z (2,), that of a sphere 0 and
            that of a capsule without its round ends.
        name: its name.
        clearance_m: distance that everything keeps from it; None: the cell's.
    """
    if kind == "box":
        core = Core(X_WC, -0.5 * sizes_m, 0.5 * sizes_m)
        if (np.abs(X_WC[:3, :3] - np.eye(3)) < ALONG_SINE).all():
            return Box(X_WC[:3, 3] - 0.5 * sizes_m, X_WC[:3, 3] + 0.5 * sizes_m, name, clearance_m)
    else:
        radius, length = sizes_m
        is_round = kind == "cylinder"
        wide = radius if is_round else 0.0
        half = np.array([wide, wide, 0.5 * length])
        core = Core(X_WC, -half, half, 0.0 if is_round else float(radius), is_round)
    return Solid(*core.bounds, name, clearance_m, kind, core)


def nearest_on_cores(p: Array, rows: Array) -> Array:
    """Returns the points of cores nearest to points (3, ...) [m].

    Args:
        p: the points.
        rows: of the shapes (20, ...), as of `Solid.row`.
    """
    R = rows[:9].reshape(3, 3, *rows.shape[1:])
    origin = rows[9:12]
    apart = p - origin
    x = R[0] * apart[0] + R[1] * apart[1] + R[2] * apart[2]
    near = np.minimum(np.maximum(x, rows[12:15]), rows[15:18])
    is_round = rows[18] > 0.0
    if is_round.any():
        inwards = np.minimum(1.0, rows[15] / np.maximum(np.hypot(x[0], x[1]), TINY_M))
        near[:2] = np.where(is_round, x[:2] * inwards, near[:2])
    return origin + R[:, 0] * near[0] + R[:, 1] * near[1] + R[:, 2] * near[2]
