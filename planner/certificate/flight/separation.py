"""Lower bounds on the distance of patches of flights from convex obstacles, by a direction that separates the two."""

from __future__ import annotations

from functools import reduce

import numpy as np

from planner.arrays import Array
from planner.certificate.flight.flights import TINY_M, nearest_on_segments
from planner.kinematics import dot


def box_bound(corners: list[Array], lower: Array, upper: Array) -> Array:
    """Returns lower bounds (...) [m] on the distance of patches from boxes.

    Args:
        corners: of the patches, each (3, ...) [m].
        lower, upper: corners of the boxes (3, ...) [m].
    """
    centre = mean(corners)
    return _separation(corners, centre, np.minimum(np.maximum(centre, lower), upper))


def segment_bound(corners: list[Array], start: Array, end: Array) -> Array:
    """Returns lower bounds (...) [m] on the distance of patches from segments.

    Args:
        corners: of the patches, each (3, ...) [m].
        start, end: of the segments (3, ...) [m].
    """
    centre = mean(corners)
    return _separation(corners, centre, nearest_on_segments(centre, start, end))


def _separation(corners: list[Array], centre: Array, near: Array) -> Array:
    """Returns min n . (corner - near) over the corners (...), with n the direction from `near` to `centre`."""
    apart = centre - near
    length = np.maximum(np.sqrt(dot(apart, apart)), TINY_M)
    least = reduce(np.minimum, [dot(apart, corner) for corner in corners])
    return (least - dot(apart, near)) / length


def mean(corners: list[Array]) -> Array:
    """Returns the mean of points, each (3, ...)."""
    return reduce(np.add, corners) / len(corners)
