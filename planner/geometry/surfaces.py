"""Surfaces that an object can land on at a place: the floor, and the tops of keep-out boxes."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.cell import CONTACT_M, Box, Cell

LEVEL_M = 0.001  # [m] tops that differ by less are one surface: no table is more level
ROUNDS = 16  # [-] of joining; each doubles how many boxes a rectangle may lie on


class Surface(NamedTuple):
    """A horizontal rectangle: lower and upper corner (2,) and height [m]."""

    lower: Array
    upper: Array
    height_m: float

    def depth(self, x: Array) -> Array:
        """Returns how far within it points (2 or 3, ...) are, horizontally (...) [m]; negative beside it."""
        lower, upper = (corner.reshape(2, *[1] * (x.ndim - 1)) for corner in (self.lower, self.upper))
        return np.minimum(x[:2] - lower, upper - x[:2]).min(axis=0)


def footprint(box: Box) -> Surface:
    """Returns the top of a box."""
    return Surface(box.lower[:2], box.upper[:2], float(box.upper[2]))


def landing_surfaces(cell: Cell, p: Array) -> tuple[Surface, ...]:
    """Returns what the cell's object touches from above before its centre comes down to a place `p` (3,).

    That is the highest surface over which the place is, if it is at its height or less than the object's radius below.
    The tops of boxes that are about as high and adjoin are one surface, and so is each rectangle within it.
    """
    around, lowest = cell.surroundings, float(p[2]) - cell.object.radius_m
    found = _joined([footprint(box) for box in around.keep_out if lowest < box.upper[2] <= p[2] + CONTACT_M])
    if lowest < around.floor_z_m:  # also of a place below it
        height_m = min(around.floor_z_m, float(p[2]))
        found.append(Surface(np.full(2, -np.inf), np.full(2, np.inf), height_m))
    below = [surface for surface in found if surface.depth(p) >= 0.0]
    highest_m = max((surface.height_m for surface in below), default=np.inf)
    return tuple(surface for surface in below if surface.height_m > highest_m - LEVEL_M)


def _joined(tops: list[Surface]) -> list[Surface]:
    """Returns the largest rectangles that lie on the tops of boxes, on one or on more."""
    found = _largest(tops)
    for _ in range(ROUNDS):
        larger = _largest(found + [each for pair in combinations(found, 2) for each in _across(*pair)])
        if len(larger) == len(found) and all(any(each is one for one in found) for each in larger):
            break
        found = larger
    return found


def _largest(surfaces: list[Surface]) -> list[Surface]:
    """Returns the surfaces without those that lie within another one."""
    found: list[Surface] = []
    for surface in surfaces:
        if not any(_contains(one, surface) for one in found):
            found = [one for one in found if not _contains(surface, one)] + [surface]
    return found


def _across(first: Surface, second: Surface) -> list[Surface]:
    """Returns the rectangles that reach from one surface to another that is as high and adjoins, as wide as both."""
    low, high = np.maximum(first.lower, second.lower), np.minimum(first.upper, second.upper)
    if abs(first.height_m - second.height_m) > LEVEL_M or (low > high + CONTACT_M).any():
        return []
    height_m = max(first.height_m, second.height_m)
    least, most, found = np.minimum(first.lower, second.lower), np.maximum(first.upper, second.upper), []
    for along in (np.array([True, False]), np.array([False, True])):
        if high[~along] > low[~along]:
            found.append(Surface(np.where(along, least, low), np.where(along, most, high), height_m))
    return found


def _contains(one: Surface, other: Surface) -> bool:
    """Returns whether a surface has all points of another."""
    return bool((one.lower <= other.lower).all() and (one.upper >= other.upper).all()) and (
        0.0 <= one.height_m - other.height_m <= LEVEL_M
    )
