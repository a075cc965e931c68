"""Distances of segments from each other and from shapes: numpy twins of planner/native/kernel/arm.c."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.kinematics import dot


def pair_distances(ends: Array, pairs: Index, shortest_m2: float) -> Array:
    """Returns the distances (p, n) of `pairs` (p, 2) of segments with `ends` (k, 2, 3, n)."""
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
    return np.minimum(np.maximum(share, 0.0), 1.0)


def shape_distances(p0: Array, p1: Array, items: Index, rows: Array) -> Array:
    """Returns the distances (n,) of segments p0-p1, each (n, 3), from shapes `items` (n,) of `rows` (k, 20)."""
    shapes = rows[items]
    R = shapes[:, :9].reshape(-1, 3, 3)
    start, end = (((p - shapes[:, 9:12])[:, None] @ R)[:, 0] for p in (p0, p1))
    corners = shapes[:, 12:15], shapes[:, 15:18]
    found = np.where(shapes[:, 18] > 0.0, cylinder_distances(start, end, *corners), box_distances(start, end, *corners))
    return found - shapes[:, 19]


def all_shape_distances(p0: Array, p1: Array, rows: Array) -> Array:
    """Returns the distances (k, n) of segments p0-p1, each (n, 3), from every shape of `rows` (k, 20)."""
    return np.array([shape_distances(p0, p1, np.full(len(p0), i), rows) for i in range(len(rows))])


def cylinder_distances(p0: Array, p1: Array, lower: Array, upper: Array) -> Array:
    """Returns the distances (n,) of segments from the cylinders about z in boxes: the slope's zero by halving."""
    low = np.zeros(len(p0))
    high = np.ones(len(p0))

    def gaps(share: Array) -> Array:
        p = p0 + share[:, None] * (p1 - p0)
        inwards = np.minimum(1.0, upper[:, :1] / np.maximum(np.hypot(p[:, :1], p[:, 1:2]), 1e-300))
        return np.concatenate(
            [p[:, :2] * (1.0 - inwards), p[:, 2:] - np.clip(p[:, 2:], lower[:, 2:], upper[:, 2:])], axis=1
        )

    for _ in range(60):
        middle = 0.5 * (low + high)
        falls = _dot(gaps(middle), p1 - p0) < 0.0
        low = np.where(falls, middle, low)
        high = np.where(falls, high, middle)
    return np.min(
        [np.linalg.norm(gaps(share), axis=1) for share in (low, high, np.zeros(len(p0)), np.ones(len(p0)))], axis=0
    )


def box_distances(p0: Array, p1: Array, lower: Array, upper: Array) -> Array:
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
    return (a * b).sum(axis=-1)
