"""Lower bounds on the distance of patches of flights from convex obstacles, by a direction that separates the two."""

from __future__ import annotations

from functools import reduce

import numpy as np

from planner.arrays import Array
from planner.cell import nearest_on_cores
from planner.certificate.flight.flights import TINY_M
from planner.kinematics import dot


def core_bound(corners: list[Array], shapes: Array) -> Array:
    """Returns lower bounds (...) [m] on the distance of patches from the cores of shapes.

    Args:
        corners: of the patches, each (3, ...) [m].
        shapes: rows of the shapes (20, ...), see `Solid.row`.
    """
    centre = mean(corners)
    near = nearest_on_cores(centre, shapes)
    apart = centre - near
    length = np.maximum(np.sqrt(dot(apart, apart)), TINY_M)
    least = reduce(np.minimum, [dot(apart, corner) for corner in corners])
    return (least - dot(apart, near)) / length


def mean(corners: list[Array]) -> Array:
    """Returns the mean of points, each (3, ...)."""
    return reduce(np.add, corners) / len(corners)
