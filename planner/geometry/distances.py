"""Exact distances from segments to segments and boxes, over leading dimensions; segments may be points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# [m^2] squared length under which a segment is a point; a capsule shorter than 1e-9 m is a sphere
POINT_M2 = 1e-18


def segment_segment_distance(p0: ArrayLike, p1: ArrayLike, q0: ArrayLike, q1: ArrayLike) -> Array:
    """Distance (...) [m] between segments p0-p1 and q0-q1, ends (..., 3) [m].

    The smallest of the distance between the lines where both nearest points lie inside the segments, and of each
    end's distance to the other segment; no case is divided by the sine of the angle between them.
    """
    p0, p1, q0, q1 = (np.asarray(x, dtype=np.float64) for x in (p0, p1, q0, q1))
    ends = np.minimum(
        np.minimum(point_segment_distance(p0, q0, q1), point_segment_distance(p1, q0, q1)),
        np.minimum(point_segment_distance(q0, p0, p1), point_segment_distance(q1, p0, p1)),
    )
    return np.minimum(ends, _inner_distance(p1 - p0, q1 - q0, q0 - p0))


def _inner_distance(u: Array, v: Array, w: Array) -> Array:
    """Distance (...) of two lines of directions u and v, w apart, or infinity where a foot is outside its segment.

    Parallel segments are nearest at an end of one of them, so they may be left to the ends.
    """
    uu, uv, vv, uw, vw = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    determinant = uu * vv - uv * uv
    crossing = determinant > np.finfo(np.float64).eps * uu * vv
    divisor = np.where(crossing, determinant, 1.0)
    s, t = (vv * uw - uv * vw) / divisor, (uv * uw - uu * vw) / divisor
    inside = crossing & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    gap = w + t[..., None] * v - s[..., None] * u
    return np.where(inside, np.sqrt(_dot(gap, gap)), np.inf)


def point_segment_distance(p: ArrayLike, q0: ArrayLike, q1: ArrayLike) -> Array:
    """Distance (...) [m] of points p (..., 3) from segments q0-q1."""
    p, q0, q1 = (np.asarray(x, dtype=np.float64) for x in (p, q0, q1))
    along, to_point = q1 - q0, p - q0
    length = _dot(along, along)
    share = np.where(length > POINT_M2, _dot(to_point, along) / np.maximum(length, POINT_M2), 0.0)
    gap = to_point - np.clip(share, 0.0, 1.0)[..., None] * along
    return np.sqrt(_dot(gap, gap))


def segment_box_distance(p0: ArrayLike, p1: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Array:
    """Distance (...) [m] of segments p0-p1, ends (..., 3), from the box between `lower` and `upper` (3,); 0 inside.

    The squared distance along the segment is convex and piecewise quadratic, with a new piece where the segment
    crosses a face's plane: its slope is linear between those points, so the zero of the slope is found exactly.
    """
    p0, p1, lower, upper = (np.asarray(x, dtype=np.float64) for x in (p0, p1, lower, upper))
    along = p1 - p0
    moving = np.where(np.abs(along) > 0.0, along, np.inf)
    crossings = np.concatenate([(lower - p0) / moving, (upper - p0) / moving], axis=-1)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*p0.shape[:-1], 2))
    knots = np.sort(np.concatenate([ends, np.clip(crossings, 0.0, 1.0)], axis=-1), axis=-1)
    gaps = _outside(p0[..., None, :] + knots[..., None] * along[..., None, :], lower, upper)
    share = _zero(knots, _dot(gaps, along[..., None, :]))
    gap = _outside(p0 + share[..., None] * along, lower, upper)
    return np.sqrt(_dot(gap, gap))


def _outside(p: Array, lower: Array, upper: Array) -> Array:
    """Vector (..., 3) from the nearest point of the box."""
    return p - np.clip(p, lower, upper)


def _zero(knots: Array, slopes: Array) -> Array:
    """Where (...) a rising, piecewise linear function (..., k) of the knots (..., k) passes zero, or the nearer end."""
    after = np.clip(np.sum(slopes < 0.0, axis=-1), 1, knots.shape[-1] - 1)[..., None]
    t0, t1 = (np.take_along_axis(knots, i, axis=-1)[..., 0] for i in (after - 1, after))
    g0, g1 = (np.take_along_axis(slopes, i, axis=-1)[..., 0] for i in (after - 1, after))
    rise = g1 - g0
    share = np.where(rise > 0.0, -g0 / np.where(rise > 0.0, rise, 1.0), 0.0)
    return t0 + np.clip(share, 0.0, 1.0) * (t1 - t0)


def _dot(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
