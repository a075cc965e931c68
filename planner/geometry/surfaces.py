"""Surfaces that an object can land on at a place: the floor, and the level tops of keep-out shapes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import CONTACT_M, Cell, Solid

ROUNDING_M = 1e-9  # [m] a target is on a top that is the object's radius below it, however that is rounded
LEVEL_M = 0.001  # [m] tops that differ by less are one surface: no table is more level


class Surface(NamedTuple):
    """A horizontal rectangle, or the top of one shape that is turned or round.

    Attributes:
        lower, upper: corners of the rectangle, or of the one that bounds the top (2,) [m].
        height_m: its height [m].
        of: the shape whose turned or round top it is; None of a rectangle along the axes, or of the floor.
    """

    lower: Array
    upper: Array
    height_m: float
    of: Solid | None = None

    def depth(self, x: Array) -> Array:
        """Returns how far within it points (2 or 3, ...) are, horizontally (...) [m]; negative beside it."""
        if self.of is not None and self.of.top is not None:
            return self.of.top.depth(x)
        lower, upper = (corner.reshape(2, *[1] * (x.ndim - 1)) for corner in (self.lower, self.upper))
        return np.minimum(x[:2] - lower, upper - x[:2]).min(axis=0)

    def is_within(self, shape: Solid) -> bool:
        """Returns whether a shape is over or under it alone: its depth is concave, and so least at a corner."""
        corners = np.array(list(product(*zip(shape.lower[:2], shape.upper[:2], strict=True)))).T
        return bool((self.depth(corners) >= 0.0).all())

    def meets(self, shape: Solid) -> bool:
        """Returns whether a shape with a level top is over or under a part of it; of a turned top only its own."""
        if self.of is not None or not shape.has_level_top or shape.core is not None:
            return self.of is shape
        return bool((shape.lower[:2] <= self.upper).all() and (shape.upper[:2] >= self.lower).all())


def footprint(shape: Solid) -> Surface:
    """Returns the top of a shape that has a level one."""
    turned = None if shape.top is None else shape
    return Surface(shape.lower[:2], shape.upper[:2], float(shape.upper[2]), turned)


def landing_surfaces(cell: Cell, p: Array) -> tuple[Surface, ...]:
    """Returns what the cell's object touches from above before its centre comes down to a place `p` (3,).

    That is the highest surface over which the place is, at its height or no more than the object's radius below it; of
    a body, than that of the largest ball within it.
    The tops of boxes along the axes that are about as high and adjoin are one surface, and so is each rectangle within
    it. A turned or a round top is one by itself.
    """
    around = cell.surroundings
    lowest = float(p[2]) - max(cell.object.inner_radius_m, CONTACT_M) - ROUNDING_M
    carriers = [shape for shape in around.keep_out if shape.has_level_top]
    tops = [footprint(shape) for shape in carriers if lowest < shape.upper[2] <= p[2] + CONTACT_M]
    under_m = max((top.height_m for top in tops if top.depth(p) >= 0.0), default=np.inf)
    level = [top for top in tops if abs(top.height_m - under_m) <= LEVEL_M]
    along = [top for top in level if top.of is None]
    found = _joined(along, p) if any(top.depth(p) >= 0.0 for top in along) else []
    found += [top for top in level if top.of is not None and top.depth(p) >= 0.0]
    if lowest < around.floor_z_m:  # also of a place below it
        height_m = min(around.floor_z_m, float(p[2]))
        found.append(Surface(np.full(2, -np.inf), np.full(2, np.inf), height_m))
    highest_m = max((surface.height_m for surface in found), default=np.inf)
    return tuple(surface for surface in found if surface.height_m > highest_m - LEVEL_M)


def _joined(tops: list[Surface], p: Array) -> list[Surface]:
    """Returns the largest rectangles over a place `p` (3,) that lie on the tops of boxes, on one or on more.

    The edges of all tops part the plane into cells, which are covered or not.
    """
    x, y = (_edges(np.array([[top.lower[axis], top.upper[axis]] for top in tops])) for axis in (0, 1))
    covered = np.zeros((len(x) - 1, len(y) - 1), bool)
    for top in tops:
        covered[_between(x, top.lower[0], top.upper[0]), _between(y, top.lower[1], top.upper[1])] = True
    around = [_largest_around(covered, i, j) for i, j in product(_at(x, p[0]), _at(y, p[1])) if covered[i, j]]
    found = []
    for first, last, least, most in dict.fromkeys(chain.from_iterable(around)):
        lower = np.array([x[first], y[least]])
        upper = np.array([x[last + 1], y[most + 1]])
        heights = [top.height_m for top in tops if _overlaps(top, lower, upper)]
        found.append(Surface(lower, upper, max(heights)))
    return found


def _overlaps(top: Surface, lower: Array, upper: Array) -> bool:
    return bool((top.lower < upper - CONTACT_M).all() and (top.upper > lower + CONTACT_M).all())


def _edges(ends: Array) -> Array:
    """Returns the increasing places (n,) at which rectangles with `ends` (k, 2) end; those that adjoin meet in one."""
    every = np.unique(ends)
    return every[np.append(True, np.diff(every) > CONTACT_M)]


def _between(edges: Array, lower: float, upper: float) -> slice:
    """Returns the intervals between `edges` (n,) from one to another."""
    first, last = np.searchsorted(edges, [lower, upper], side="right") - 1
    return slice(int(first), int(last))


def _at(edges: Array, place: float) -> range:
    """Returns the intervals between `edges` (n,) that a place is in: two at an edge."""
    place = min(max(place, edges[0]), edges[-1])
    first, last = (int(np.searchsorted(edges, place, side=side)) for side in ("left", "right"))
    return range(max(first - 1, 0), min(last, len(edges) - 1))


def _largest_around(covered: Mask, i: int, j: int) -> Iterator[tuple[int, int, int, int]]:
    """Yields the largest rectangles of `covered` cells (m, n) around cell i, j: first and last row and column.

    For every range of rows it is as wide as the narrowest of them, and not the largest if a further row is as wide.
    """
    top, bottom = _span(covered[:, j], i)
    spans = np.array([_span(row, j) for row in covered[top : bottom + 1]])
    widths: dict[tuple[int, int], tuple[int, int]] = {}
    for first, last in product(range(top, i + 1), range(i, bottom + 1)):
        least, most = spans[first - top : last - top + 1].T
        widths[first, last] = int(least.max()), int(most.min())
    for (first, last), width in widths.items():
        if width not in (widths.get((first - 1, last)), widths.get((first, last + 1))):
            yield first, last, *width


def _span(covered: Mask, j: int) -> tuple[int, int]:
    """Returns the first and the last of the `covered` cells (n,) of a row or column that are one piece with cell j."""
    before = np.flatnonzero(~covered[:j])
    after = np.flatnonzero(~covered[j:])
    return int(before[-1]) + 1 if len(before) else 0, j + int(after[0]) - 1 if len(after) else len(covered) - 1
