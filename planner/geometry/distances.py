"""Exact distances of points and segments from segments and shapes, over leading dimensions; a point is a segment."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, Index
from planner.cell import Solid
from planner.native import loops

POINT_M2 = 1e-18  # [m^2] squared length below which a segment is a point: a capsule shorter than 1e-9 m is a sphere


def segment_segment_distance(p0: ArrayLike, p1: ArrayLike, q0: ArrayLike, q1: ArrayLike) -> Array:
    """Returns the distance (...) [m] between segments p0-p1 and q0-q1.

    The closest point on the first line is clamped to the first segment, then the closest point to it on the second
    segment is found, then the closest to that on the first: exact, because the squared distance is convex in both
    parameters. For parallel lines any point of the first serves as a start.
    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.9.

    Args:
        p0, p1, q0, q1: ends (..., 3) [m].
    """
    ends = np.array(np.broadcast_arrays(p0, p1, q0, q1), dtype=np.float64)
    segments = ends.reshape(2, 2, -1, 3, 1).swapaxes(1, 2).reshape(-1, 2, 3, 1)
    pairs = np.arange(len(segments)).reshape(2, -1).T
    return pair_distances(segments, pairs).reshape(ends.shape[1:-1])


def pair_distances(ends: Array, pairs: Index) -> Array:
    """Returns the distances (p, n) [m] of p `pairs` (p, 2) of segments; see `segment_segment_distance`.

    Args:
        ends: of k segments at n instants (k, 2, 3, n) [m].
        pairs: indices of two segments each.
    """
    return loops.pair_distances(ends, pairs, POINT_M2)


def _clamped(share: Array) -> Array:
    """Returns the place on a line clamped to its segment, whose ends are at 0 and 1."""
    return np.minimum(np.maximum(share, 0.0), 1.0)


def point_segment_distance(x: Array, p0: Array, p1: Array) -> Array:
    """Returns the distances (...) [m] of points (..., 3) from the segment with ends p0, p1 (3,), which may be a point.

    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.2.
    """
    along = p1 - p0
    out = x - p0
    share = _clamped(_dot(out, along) / max(float(along @ along), POINT_M2))
    gap = out - share[..., None] * along
    return np.sqrt(_dot(gap, gap))


def segment_shape_distance(p0: ArrayLike, p1: ArrayLike, shape: Solid) -> Array:
    """Returns the distance (...) [m] of segments p0-p1 from a shape; where they meet its core, minus its radius.

    The squared distance from a convex core is convex along the segment. From a box it is piecewise quadratic, with a
    new piece where the segment crosses the plane of a face: its slope is linear between those points, so the zero of
    the slope is found exactly. From a cylinder its zero is found to rounding, by Newton's iteration within a bracket.

    Args:
        p0, p1: ends (..., 3) [m].
        shape: the shape.
    """
    starts, ends = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (p0, p1)))
    items = np.zeros(starts.size // 3, np.intp)
    return shape_distances(starts.reshape(-1, 3), ends.reshape(-1, 3), items, shape.row[None]).reshape(
        starts.shape[:-1]
    )


def shape_distances(p0: Array, p1: Array, items: Index, rows: Array) -> Array:
    """Returns the distances (n,) [m] of segments p0-p1, each (n, 3), from shapes; see `segment_shape_distance`.

    Args:
        p0, p1: ends [m].
        items: number of the shape for each (n,).
        rows: of the shapes (k, 20), as of `Solid.row`.
    """
    return loops.shape_distances(p0, p1, items, rows)


def _dot(a: Array, b: Array) -> Array:
    """Returns the dot product (...) of vectors (..., 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
