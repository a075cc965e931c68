"""Capsules that cover a box, a cylinder, or boxes side by side: those of a tool, which is made of capsules alone.

Across the longest side the whole is divided into a grid. About what is in each of its cells there is a box, and about
each of these boxes a capsule along its longest side: the boxes contain the shape, and the capsules the boxes. The grid
gets finer, in the direction in which its cells are longer, until nothing reaches far beyond the shape.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index

SAMPLES = 300  # [-] directions about each of `PLACES` points of a capsule, at which its excess is measured
PLACES = 9
MOST = 8  # [-] capsules of one shape: the arm has twelve, and each takes its time in every check
ENOUGH_M = 0.01  # [m] beyond the shape at which a grid is fine enough: half of the default clearance
Within = Callable[[Array, Array], tuple[Array, Array] | None]  # corners of a cell -> of a box about what is in it
Distance = Callable[[Array], Array]  # of points (n, 3) from the shape (n,) [m]; 0 inside


class CoverCapsule(NamedTuple):
    """A capsule in the frame of what it covers: ends (3,) [m] and radius [m]."""

    start: Array
    end: Array
    radius_m: float


class CapsuleCover(NamedTuple):
    """Capsules that contain a shape, and how far they reach beyond it, by many samples [m]."""

    capsules: tuple[CoverCapsule, ...]
    beyond_m: float


def round_cover(radius_m: float, length_m: float) -> CapsuleCover:
    """Returns the capsule that a sphere or capsule is itself; `length_m` without its round ends."""
    end = np.array([0.0, 0.0, 0.5 * length_m])
    return CapsuleCover((CoverCapsule(-end, end, radius_m),), 0.0)


def boxes_cover(lower: Array, upper: Array) -> CapsuleCover:
    """Returns capsules that contain boxes along the same axes, with corners (k, 3) [m]."""

    def within(cell_lower: Array, cell_upper: Array) -> tuple[Array, Array] | None:
        low = np.maximum(lower, cell_lower)
        high = np.minimum(upper, cell_upper)
        met = (low <= high).all(axis=1)
        return (low[met].min(axis=0), high[met].max(axis=0)) if met.any() else None

    def distance(p: Array) -> Array:
        apart = p[:, None] - np.clip(p[:, None], lower, upper)
        return np.linalg.norm(apart, axis=2).min(axis=1)

    return _finest(lower.min(axis=0), upper.max(axis=0), within, distance)


def cylinder_cover(radius_m: float, length_m: float) -> CapsuleCover:
    """Returns capsules that contain a cylinder about z: one along it, or several across one that is flat."""
    half = 0.5 * length_m
    side = np.array([radius_m, radius_m, half])

    def within(cell_lower: Array, cell_upper: Array) -> tuple[Array, Array] | None:
        near = np.maximum(0.0, np.maximum(cell_lower, -cell_upper))  # of the cell's points, from each axis
        if np.hypot(near[0], near[1]) >= radius_m:
            return None
        reach = np.append(np.sqrt(radius_m**2 - near[1::-1] ** 2), half)
        return np.maximum(cell_lower, -reach), np.minimum(cell_upper, reach)

    def distance(p: Array) -> Array:
        out = np.hypot(p[:, 0], p[:, 1]) - radius_m
        return np.hypot(np.maximum(out, 0.0), np.maximum(np.abs(p[:, 2]) - half, 0.0))

    inwards = min(radius_m, half)
    end = np.array([0.0, 0.0, half - inwards])
    one = _measured([CoverCapsule(-end, end, float(np.hypot(radius_m, inwards)))], distance)
    return one if one.beyond_m <= ENOUGH_M else min(one, _finest(-side, side, within, distance), key=_excess)


def _finest(lower: Array, upper: Array, within: Within, distance: Distance) -> CapsuleCover:
    """Returns the cover of the first grid that is fine enough, or else of the one that reaches least beyond."""
    size = upper - lower
    across = [axis for axis in range(3) if axis != size.argmax()]
    counts = np.ones(3, int)
    found: list[CapsuleCover] = []
    while True:
        boxes = _boxes(lower, upper, counts, within)
        if len(boxes) > MOST:
            break
        found.append(_measured([_about(*box) for box in boxes], distance))
        if found[-1].beyond_m <= ENOUGH_M:
            break
        counts[max(across, key=lambda axis: float(size[axis] / counts[axis]))] += 1
    return min(found, key=_excess)


def _boxes(lower: Array, upper: Array, counts: Index, within: Within) -> list[tuple[Array, Array]]:
    """Returns boxes about what is in each cell of a grid."""
    edges = [pairwise(np.linspace(*ends)) for ends in zip(lower, upper, counts + 1, strict=True)]
    cells = (np.array(cell).T for cell in product(*edges))
    return [box for low, high in cells if (box := within(low, high)) is not None]


def _about(lower: Array, upper: Array) -> CoverCapsule:
    """Returns a capsule about a box, along its longest side.

    Its corners are where the round ends begin to leave it: as far inwards as half its shortest side, beyond the ends
    the capsule reaches as far as beyond the nearest side.
    """
    half = 0.5 * (upper - lower)
    along = int(half.argmax())
    inwards = float(half.min())
    end = np.zeros(3)
    end[along] = half[along] - inwards
    middle = 0.5 * (lower + upper)
    corner = half - end
    return CoverCapsule(middle - end, middle + end, float(np.linalg.norm(corner)))


def _measured(capsules: list[CoverCapsule], distance: Distance) -> CapsuleCover:
    """Returns capsules as a cover, with the farthest of samples of their surfaces."""
    k = np.arange(SAMPLES) + 0.5
    z = 1.0 - 2.0 * k / SAMPLES
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k  # a spiral that is evenly dense
    flat = np.sqrt(1.0 - z**2)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    shares = np.linspace(0.0, 1.0, PLACES)[:, None, None]
    points = [c.start + shares * (c.end - c.start) + c.radius_m * directions for c in capsules]
    return CapsuleCover(tuple(capsules), float(distance(np.concatenate(points).reshape(-1, 3)).max()))


def _excess(cover: CapsuleCover) -> float:
    return cover.beyond_m
