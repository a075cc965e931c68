"""What an object in flight can touch: keep-out boxes and a bin.

An obstacle measures the gap between a sphere and itself, so that the world can advance a flight by what is certainly
free, and tells what becomes of an object that touches it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

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


@dataclass(frozen=True)
class SolidBox:
    """A keep-out box, with sides parallel to the axes of the world."""

    name: str
    lower: Point
    upper: Point

    def gap(self, p: Point, radius: float) -> float:
        """Returns the distance of a sphere around `p` from the box [m]."""
        outside = [max(low - x, 0.0, x - up) for low, x, up in zip(self.lower, p, self.upper, strict=True)]
        return math.hypot(*outside) - radius

    def contact(self, p: Point) -> Contact:
        """Returns the contact: an object lies down on the top and stops at every other face, edge and corner."""
        above = all(low <= x <= up for low, x, up in zip(self.lower[:2], p, self.upper[:2], strict=False))
        if above and p[2] >= self.upper[2]:
            return Contact(self.name, self.upper[2], slides=True)
        return Contact(self.name)

    def holds(self, p: Point) -> bool:
        """Whether a point lies in the box."""
        return all(low <= x <= up for low, x, up in zip(self.lower, p, self.upper, strict=True))


@dataclass(frozen=True)
class RoundBin:
    """A bin that is open upwards: a thin upright wall around a thin bottom.

    Attributes:
        bottom: centre of the bottom in the world [m].
        radius_m: inner radius [m].
        rim_height_m: height of the rim above the bottom [m].
    """

    bottom: Point
    radius_m: float
    rim_height_m: float

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
