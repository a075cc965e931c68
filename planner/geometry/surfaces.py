"""Surfaces that an object can land on: the floor, and the tops of keep-out boxes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from planner.arrays import Array
from planner.cell import CONTACT_M, Cell

Rectangle = tuple[Array, Array]  # horizontal lower and upper corner (2,) [m]


def landing_surfaces(cell: Cell, height_m: float) -> tuple[Rectangle, ...]:
    """Returns the horizontal surfaces at a height [m]: without bounds on the floor, or else the tops of boxes.

    What adjoins and is as wide is one surface, as an object lands on a table of two halves.
    """
    around = cell.surroundings
    if height_m <= around.floor_z_m + CONTACT_M:
        return ((np.full(2, -np.inf), np.full(2, np.inf)),)
    tops = [box for box in around.keep_out if abs(float(box.upper[2]) - height_m) <= CONTACT_M]
    return tuple(_merged([(box.lower[:2], box.upper[:2]) for box in tops]))


def depth_within(rectangle: Rectangle, x: Array) -> Array:
    """Returns how far within a rectangle points (2 or 3, ...) are, horizontally (...) [m]; negative beside it."""
    lower, upper = (corner.reshape(2, *[1] * (x.ndim - 1)) for corner in rectangle)
    return np.minimum(x[:2] - lower, upper - x[:2]).min(axis=0)


def _merged(rectangles: Sequence[Rectangle]) -> list[Rectangle]:
    """Returns rectangles, two of them as one while that has no other points."""
    found = list(rectangles)
    while (pair := next(_adjoining(found), None)) is not None:
        i, j = pair
        (first, last), (begin, end) = found[i], found[j]
        found = [each for k, each in enumerate(found) if k not in pair]
        found.append((np.minimum(first, begin), np.maximum(last, end)))
    return found


def _adjoining(rectangles: Sequence[Rectangle]) -> Iterator[tuple[int, int]]:
    """Yields pairs of rectangles that together are one."""
    for (i, (first, last)), (j, (begin, end)) in combinations(enumerate(rectangles), 2):
        touch = np.minimum(last, end) - np.maximum(first, begin) >= -CONTACT_M
        alike = np.maximum(np.abs(first - begin), np.abs(last - end)) <= CONTACT_M
        if touch.all() and alike.any():
            yield i, j
