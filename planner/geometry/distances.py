"""Exact distances from segments to segments and boxes, over leading dimensions; segments may be points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# [m^2] squared length under which a segment is a point; a capsule shorter than 1e-9 m is a sphere
POINT_M2 = 1e-18


def segment_segment_distance(p0: ArrayLike, p1: ArrayLike, q0: ArrayLike, q1: ArrayLike, *, axis: int = -1) -> Array:
    """Distance (...) [m] between segments p0-p1 and q0-q1, ends (..., 3) with the coordinates along `axis`.

    The nearest points of the lines, put back onto the first segment, then the second's nearest point to it, then the
    first's to that: exact, as the squared distance is convex in both. For parallel lines any point of the first
    serves to begin with. Source: Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    p0, p1, q0, q1 = (np.moveaxis(np.asarray(x, dtype=np.float64), axis, 0) for x in (p0, p1, q0, q1))
    u, v, w = p1 - p0, q1 - q0, q0 - p0
    uu, uv, vv, uw, vw = _along(u, u), _along(u, v), _along(v, v), _along(u, w), _along(v, w)
    determinant = uu * vv - uv * uv
    crossing = determinant > np.finfo(np.float64).eps * uu * vv
    s = _onto((vv * uw - uv * vw) * crossing / np.where(crossing, determinant, 1.0))
    t = _onto((s * uv - vw) / np.maximum(vv, POINT_M2))
    s = _onto((uw + t * uv) / np.maximum(uu, POINT_M2))
    gap = w + t * v - s * u
    return np.sqrt(_along(gap, gap))


def _onto(share: Array) -> Array:
    """The place on the line put back onto the segment, whose ends are at 0 and 1."""
    return np.minimum(np.maximum(share, 0.0), 1.0)


def _along(a: Array, b: Array) -> Array:
    """Scalar product (...) of vectors (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_box_distance(p0: ArrayLike, p1: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Array:
    """Distance (...) [m] of segments p0-p1, ends (..., 3), from the box between `lower` and `upper` (..., 3); 0 inside.

    The squared distance along the segment is convex and piecewise quadratic, with a new piece where the segment
    crosses a face's plane: its slope is linear between those points, so the zero of the slope is found exactly.
    """
    p0, p1, lower, upper = (np.asarray(x, dtype=np.float64) for x in (p0, p1, lower, upper))
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
