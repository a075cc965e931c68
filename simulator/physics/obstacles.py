"""What an object in flight can touch: keep-out shapes and a bin.

An obstacle measures the gap between a sphere and itself, so that the world can advance a flight by what is certainly
free, and tells what becomes of an object that touches it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from planner.cell import Solid
from planner.geometry import footprint

Point = tuple[float, ...]  # x y z in the world [m]

BIN = "bin"
BIN_WALL = "bin wall"


@dataclass(frozen=True)
class Contact:
    """What an object touches.

    Attributes:
        name: of the obstacle.
        lies_at_z_m: height at which the object's centre comes to lie [m]; None: it stops where it is.
        slides: whether it keeps its horizontal speed on the way to that height.
    """

    name: str
    lies_at_z_m: float | None = None
    slides: bool = False


class Obstacle(Protocol):
    """Something solid beside a flight."""

    def gap(self, p: Point, radius: float) -> float:
        """Returns the distance of a sphere around `p` from the obstacle [m]."""
        ...

    def contact(self, p: Point) -> Contact:
        """Returns what a sphere around `p` touches, given that it touches this obstacle."""
        ...


class SolidShape:
    """A keep-out shape.

    Attributes:
        name: of the obstacle.
        top_z: its greatest height [m].
    """

    def __init__(self, name: str, shape: Solid) -> None:
        row = shape.row.tolist()
        self.name = name
        self.top_z = float(shape.upper[2])
        self._shape = shape
        self._is_along_axes = shape.core is None
        self._axes = list(zip(row[:3], row[3:6], row[6:9], strict=True))
        self._origin = row[9:12]
        self._lower = row[12:15]
        self._upper = row[15:18]
        self._is_round = row[18] > 0.0
        self._radius_m = row[19]

    def gap(self, p: Point, radius: float) -> float:
        """Returns the distance of a sphere around `p` from the shape [m]."""
        x, y, z = p if self._is_along_axes else self._in_shape(p)
        if self._is_round:
            aside = max(math.hypot(x, y) - self._upper[0], 0.0)
            return math.hypot(aside, max(self._lower[2] - z, 0.0, z - self._upper[2])) - radius
        outside = [max(low - x, 0.0, x - up) for low, x, up in zip(self._lower, (x, y, z), self._upper, strict=True)]
        return math.hypot(*outside) - self._radius_m - radius

    def contact(self, p: Point) -> Contact:
        """Returns the contact: an object lies down on a level top and stops at all else."""
        is_above = self._shape.has_level_top and footprint(self._shape).depth(np.array(p)) >= 0.0
        if is_above and p[2] >= self.top_z:
            return Contact(self.name, self.top_z, slides=True)
        return Contact(self.name)

    def holds(self, p: Point) -> bool:
        """Whether a point lies in the shape."""
        return self.gap(p, 0.0) <= 0.0

    def _in_shape(self, p: Point) -> list[float]:
        """Returns a point of the world in the shape's frame."""
        apart = [x - origin for x, origin in zip(p, self._origin, strict=True)]
        return [sum(a * x for a, x in zip(axis, apart, strict=True)) for axis in self._axes]


@dataclass(frozen=True)
class RoundBin:
    """A bin that is open upwards: a thin upright wall around a thin bottom.

    Attributes:
        bottom: centre of the bottom in the world [m].
        radius_m: inner radius [m].
        rim_height_m: height of the rim above the bottom [m].
        velocity: of the belt that carries it [m/s].
        at_s: when its bottom is there [s].
    """

    bottom: Point
    radius_m: float
    rim_height_m: float
    velocity: Point = (0.0, 0.0, 0.0)
    at_s: float = 0.0

    def at(self, t: float) -> RoundBin:
        """Returns the bin as it stands at a time [s]."""
        if not any(self.velocity):
            return self
        x, y, z = (p + (t - self.at_s) * v for p, v in zip(self.bottom, self.velocity, strict=True))
        return replace(self, bottom=(x, y, z), at_s=t)

    def gap(self, p: Point, radius: float) -> float:
        """Returns the distance of a sphere around `p` from the wall [m]; from the bottom, where it is below it."""
        aside = self._from_axis(p) - self.radius_m
        below = self.bottom[2] - p[2]
        if below > 0.0:
            return math.hypot(max(aside, 0.0), below) - radius
        return math.hypot(aside, max(-below - self.rim_height_m, 0.0)) - radius

    def contact(self, p: Point) -> Contact:
        """Returns the contact: the wall's inside lets an object fall to the bottom, all else stops it."""
        return Contact(BIN, self.bottom[2]) if self.encloses(p) else Contact(BIN_WALL)

    def encloses(self, p: Point) -> bool:
        """Whether a point lies between bottom and mouth."""
        return self.spans(p) and 0.0 <= p[2] - self.bottom[2] <= self.rim_height_m

    def spans(self, p: Point) -> bool:
        """Whether a point lies above or below the bottom."""
        return self._from_axis(p) < self.radius_m

    def _from_axis(self, p: Point) -> float:
        return math.hypot(p[0] - self.bottom[0], p[1] - self.bottom[1])
