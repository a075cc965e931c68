"""Exact distances of points and segments from segments and boxes, over leading dimensions; a segment may be a point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, Index
from planner.kernel import Kernel, twin_of
from planner.kinematics import dot

POINT_M2 = 1e-18  # [m^2] squared length below which a segment is a point: a capsule shorter than 1e-9 m is a sphere


def segment_segment_distance(p0: ArrayLike, p1: ArrayLike, q0: ArrayLike, q1: ArrayLike, *, axis: int = -1) -> Array:
    """Returns the distance (...) [m] between segments p0-p1 and q0-q1.

    The closest point on the first line is clamped to the first segment, then the closest point to it on the second
    segment is found, then the closest to that on the first: exact, because the squared distance is convex in both
    parameters. For parallel lines any point of the first serves as a start.
    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.9.

    Args:
        p0, p1, q0, q1: ends (..., 3) [m].
        axis: axis of the coordinates in each of them.
    """
    ends = [np.asarray(x, dtype=np.float64) for x in (p0, p1, q0, q1)]
    if any(x.shape != ends[0].shape for x in ends):
        ends = np.broadcast_arrays(*ends)
    before = ends[0].shape[:axis]
    (_, *after) = ends[0].shape[axis:]
    grouped = np.array([x.reshape(math.prod(before), 3, math.prod(after)) for x in ends])
    segments = grouped.reshape(2, 2, *grouped.shape[1:]).swapaxes(1, 2).reshape(-1, 2, *grouped.shape[2:])
    pairs = np.arange(len(segments)).reshape(2, -1).T
    return pair_distances(segments, pairs).reshape((*before, *after))


def pair_distances(ends: Array, pairs: Index) -> Array:
    """Returns the distances (p, n) [m] of p `pairs` (p, 2) of segments; see `segment_segment_distance`.

    Args:
        ends: of k segments at n instants (k, 2, 3, n) [m].
        pairs: indices of two segments each.
    """
    return _pair_distances(ends, pairs, POINT_M2)


def _pair_example() -> tuple[Array, Index, float]:
    """Returns random segments, parallel ones, points, and segments that touch."""
    p0, p1, q0, q1 = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 8, 3, 3))
    q1[1] = q0[1] + 2.0 * (p1[1] - p0[1])
    q1[3] = q0[3]
    q0[4] = p1[4]
    p1[2] = p0[2]
    p1[5] = p0[5]
    q1[5] = q0[5]
    ends = np.concatenate([np.stack([p0, p1], axis=1), np.stack([q0, q1], axis=1)])
    return ends, np.array([[i, i + 8] for i in range(8)]), POINT_M2


@twin_of(Kernel.pair_distances, _pair_example)
def _pair_distances(ends: Array, pairs: Index, shortest_m2: float) -> Array:
    (p0, p1), (q0, q1) = (ends[side].transpose(1, 2, 0, 3) for side in pairs.T)
    u = p1 - p0
    v = q1 - q0
    w = q0 - p0
    uu = dot(u, u)
    uv = dot(u, v)
    vv = dot(v, v)
    uw = dot(u, w)
    vw = dot(v, w)
    determinant = uu * vv - uv * uv
    crossing = determinant > np.finfo(np.float64).eps * uu * vv
    s = _clamped((vv * uw - uv * vw) * crossing / np.where(crossing, determinant, 1.0))
    t = _clamped((s * uv - vw) / np.maximum(vv, shortest_m2))
    s = _clamped((uw + t * uv) / np.maximum(uu, shortest_m2))
    gap = w + t * v - s * u
    return np.sqrt(dot(gap, gap))


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


def segment_box_distance(p0: ArrayLike, p1: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Array:
    """Returns the distance (...) [m] of segments p0-p1 from a box; 0 where they meet it.

    The squared distance along the segment is convex and piecewise quadratic, with a new piece where the segment
    crosses the plane of a face: its slope is linear between those points, so the zero of the slope is found exactly.

    Args:
        p0, p1: ends (..., 3) [m].
        lower, upper: corners of the box (..., 3) [m].
    """
    arrays = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (p0, p1, lower, upper)))
    return _box_distances(*(x.reshape(-1, 3) for x in arrays)).reshape(arrays[0].shape[:-1])


def _box_example() -> tuple[Array, Array, Array, Array]:
    """Returns random segments, some along a face, points, and one through the box."""
    p0, p1, low, size = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 12, 3))
    p1[1, 0] = p0[1, 0]
    p1[2, 1:] = p0[2, 1:]
    p1[3] = p0[3]
    p0[4] = low[4] - 0.1
    p1[4] = low[4] + np.abs(size[4]) + 0.1
    return p0, p1, low, low + np.abs(size)


@twin_of(Kernel.box_distances, _box_example)
def _box_distances(p0: Array, p1: Array, lower: Array, upper: Array) -> Array:
    """Returns the distances (n,) of segments from boxes, each (n, 3)."""
    along = p1 - p0
    moving = np.where(np.abs(along) > 0.0, along, np.inf)
    crossings = np.concatenate([(lower - p0) / moving, (upper - p0) / moving], axis=-1)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*p0.shape[:-1], 2))
    knots = np.sort(np.concatenate([ends, np.clip(crossings, 0.0, 1.0)], axis=-1), axis=-1)
    gaps = _outside(p0[..., None, :] + knots[..., None] * along[..., None, :], lower[..., None, :], upper[..., None, :])
    share = _zero(knots, _dot(gaps, along[..., None, :]))
    gap = _outside(p0 + share[..., None] * along, lower, upper)
    return np.sqrt(_dot(gap, gap))


def _outside(p: Array, lower: Array, upper: Array) -> Array:
    """Returns the vector (..., 3) from the closest point of the box."""
    return p - np.clip(p, lower, upper)


def _zero(knots: Array, slopes: Array) -> Array:
    """Returns where (...) an increasing piecewise linear function crosses zero, or the nearer end.

    Args:
        knots, slopes: the function's arguments and values (..., k).
    """
    after = np.clip(np.sum(slopes < 0.0, axis=-1), 1, knots.shape[-1] - 1)[..., None]
    t0, t1 = (np.take_along_axis(knots, i, axis=-1)[..., 0] for i in (after - 1, after))
    g0, g1 = (np.take_along_axis(slopes, i, axis=-1)[..., 0] for i in (after - 1, after))
    rise = g1 - g0
    share = np.where(rise > 0.0, -g0 / np.where(rise > 0.0, rise, 1.0), 0.0)
    return t0 + np.clip(share, 0.0, 1.0) * (t1 - t0)


def _dot(a: Array, b: Array) -> Array:
    """Returns the dot product (...) of vectors (..., 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
