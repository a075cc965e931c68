"""Joint states at the release: numpy twins of planner/native/kernel/states.c and velocities.c."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask

SIGNS = np.array(list(product((1.0, -1.0), repeat=3)))  # of shoulder, wrist and elbow of the eight branches


class Lengths(NamedTuple):
    """Lengths of an arm [m], and what counts as rounding."""

    base: float
    side: float
    wrist: float
    tool: float
    upper: float
    fore: float
    reach: float
    free: float


def branches(X: Array, lengths: Array) -> Array:
    """Returns joint positions and missing reach (n, 8, 7) of flange poses `X` (n, 4, 4)."""
    q, excess = _closed_form(Lengths(*lengths), X)
    return np.concatenate([q, excess[..., None]], axis=-1)


def _closed_form(arm: Lengths, X_BF: Array) -> tuple[Array, Array]:
    """Returns the eight branches (..., 8, 6) of the flange's pose, and how far each is out of reach (..., 8) [m].

    A branch out of reach is the closest to it.
    """
    x6, y6, z6 = (X_BF[..., None, :3, k] for k in range(3))
    p5 = X_BF[..., None, :3, 3] - arm.tool * z6
    q1, short = _shoulder(p5, arm)
    across, along = _plane(q1)
    q5, c6, s6, free = _wrist(across, x6, y6, z6, arm)
    p = np.stack([_dot(p5, along), p5[..., 2] - arm.base + 0.0 * q1], axis=-1)  # wrist centre in the arm's plane
    z4 = -(s6[..., None] * x6 + c6[..., None] * y6)
    down = np.stack([_dot(z4, along), z4[..., 2]], axis=-1)  # from wrist 1 to the wrist's centre, in the arm's plane
    down = np.where(free[..., None], _elbow_at_right_angle(p, arm), down)
    q6 = np.where(free, _last_joint(down, along, x6, y6), np.arctan2(s6, c6))
    q2, q3, beyond = _elbow(p - arm.wrist * down, arm)
    q4 = np.arctan2(down[..., 0], -down[..., 1]) - q2 - q3
    q = wrapped(np.stack(np.broadcast_arrays(q1, q2, q3, q4, q5, q6), axis=-1))
    return q, np.maximum(short, beyond)


def _shoulder(p5: Array, arm: Lengths) -> tuple[Array, Array]:
    """Returns joint 1 (..., 8) with the wrist's centre `side` beside the arm's plane, and the missing reach [m]."""
    x = p5[..., 0]
    y = p5[..., 1]
    radius = np.hypot(x, y)
    ahead = np.sqrt(np.maximum((radius - arm.side) * (radius + arm.side), 0.0))
    q1 = np.arctan2(y, x) + np.arctan2(arm.side, SIGNS[:, 0] * ahead)
    return q1, _beyond_tolerance(arm.side - radius, arm) + 0.0 * q1


def _plane(q1: Array) -> tuple[Array, Array]:
    """Returns horizontal directions (..., 3) across the arm's plane (axes 2, 3, 4) and along it."""
    cos = np.cos(q1)
    sin = np.sin(q1)
    nothing = np.zeros_like(q1)
    return np.stack([sin, -cos, nothing], axis=-1), np.stack([cos, sin, nothing], axis=-1)


def _wrist(across: Array, x6: Array, y6: Array, z6: Array, arm: Lengths) -> tuple[Array, Array, Array, Mask]:
    """Returns joint 5, cosine and sine of joint 6 (..., 8), and where joint 6 is free.

    The axes 2, 3, 4 are (s5 c6, -s5 s6, c5) in the flange.
    """
    x = _dot(across, x6)
    y = _dot(across, y6)
    z = _dot(across, z6)
    sine = np.hypot(x, y)
    free = sine < arm.free
    scale = SIGNS[:, 1] / np.where(free, 1.0, sine)
    return np.arctan2(SIGNS[:, 1] * sine, z), x * scale, -y * scale, free


def _elbow_at_right_angle(p: Array, arm: Lengths) -> Array:
    """Returns the direction (..., 2) from wrist 1 to the wrist's centre with the elbow closest to a right angle."""
    reach = np.maximum(np.hypot(p[..., 0], p[..., 1]), arm.reach)
    wanted = arm.upper**2 + arm.fore**2
    cosine = np.clip((reach**2 + arm.wrist**2 - wanted) / (2.0 * reach * arm.wrist), -1.0, 1.0)
    angle = np.arctan2(p[..., 1], p[..., 0]) + np.arccos(cosine)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _last_joint(down: Array, along: Array, x6: Array, y6: Array) -> Array:
    """Returns joint 6 (..., 8) with the axis of joint 5 along `down`."""
    z4 = down[..., :1] * along + down[..., 1:] * np.array([0.0, 0.0, 1.0])
    return np.arctan2(-_dot(z4, x6), -_dot(z4, y6))


def _elbow(p4: Array, arm: Lengths) -> tuple[Array, Array, Array]:
    """Returns joints 2 and 3 (..., 8) with wrist 1 at a point (..., 2) of the arm's plane; the missing reach [m]."""
    upper = arm.upper
    fore = arm.fore
    reach = np.hypot(p4[..., 0], p4[..., 1])
    longest = abs(upper + fore)
    shortest = abs(upper - fore)
    room = np.maximum(longest - reach, 0.0) * (longest + reach)
    slack = np.maximum(reach - shortest, 0.0) * (reach + shortest)
    q3 = SIGNS[:, 2] * 2.0 * np.arctan2(np.sqrt(room), np.sqrt(slack))  # half-angle form: exact near 0 and pi
    q2 = np.arctan2(p4[..., 1], p4[..., 0]) - np.arctan2(fore * np.sin(q3), upper + fore * np.cos(q3))
    return q2, q3, _beyond_tolerance(np.maximum(reach - longest, shortest - reach), arm)


def _beyond_tolerance(excess: Array, arm: Lengths) -> Array:
    return np.where(excess > arm.reach, excess, 0.0)


def _dot(a: Array, b: Array) -> Array:
    """Returns the dot product (...) of vectors (..., 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def wrapped(q: Array) -> Array:
    """Returns the same angles in (-pi, pi]."""
    return q - 2.0 * np.pi * np.ceil(q / (2.0 * np.pi) - 0.5)


def least_norms(J: Array, weight: Array, v: Array, floor: float) -> Array:
    """Returns joint velocities (k, 6) for velocities `v` (k, 3), Jacobians `J` (n, 3, 6) taken in turn."""
    return _weighted(J[np.arange(len(v)) % len(J)], weight, v, floor)


def _weighted(J: Array, weight: Array, v: Array, floor: float, refinements: int = 0) -> Array:
    """Returns the weighted least-norm joint velocities (..., 6): W J^T (J W J^T)^-1 v for weights (..., 6).

    By Cramer's rule: for three rows and equal weights as accurate as a general solver, and far faster over thousands of
    states. Each refinement adds the solution for what the one before misses of v.
    """
    x, y, z = (J[..., i, :] for i in range(3))
    wx = weight * x
    wy = weight * y
    wz = weight * z
    xx = _einsum(wx, x)
    yy = _einsum(wy, y)
    zz = _einsum(wz, z)
    xy = _einsum(wx, y)
    xz = _einsum(wx, z)
    yz = _einsum(wy, z)
    least = floor * (xx + yy + zz)
    xx = xx + least
    yy = yy + least
    zz = zz + least
    c00 = yy * zz - yz * yz
    c01 = xz * yz - xy * zz
    c02 = xy * yz - xz * yy
    c11 = xx * zz - xz * xz
    c12 = xy * xz - xx * yz
    c22 = xx * yy - xy * xy
    scale = 1.0 / (xx * c00 + xy * c01 + xz * c02)

    def solution(v: Array) -> Array:
        a = v[..., 0] * scale
        b = v[..., 1] * scale
        c = v[..., 2] * scale
        first = c00 * a + c01 * b + c02 * c
        second = c01 * a + c11 * b + c12 * c
        third = c02 * a + c12 * b + c22 * c
        return first[..., None] * wx + second[..., None] * wy + third[..., None] * wz

    qd = solution(v)
    for _ in range(refinements):
        qd = qd + solution(v - _einsum(J, qd[..., None, :]))
    return qd


def _einsum(a: Array, b: Array) -> Array:
    return np.einsum("...j,...j->...", a, b)


def largest_shares(qd: Array, qd_max: Array) -> Array:
    """Returns the largest shares (k,) of the limits (6,) in joint velocities `qd` (k, 6)."""
    return (np.abs(qd) / qd_max).max(axis=-1)


def lower_shares(
    states: tuple[Array, Array, Array], qd_max: Array, norms: Array, floors: tuple[float, float], times: int
) -> Array:
    """Returns joint velocities (k, 6) with smaller shares of the limits: iteratively reweighted least squares."""
    J, v, qd = states
    for p in norms:
        share = np.abs(qd) / qd_max
        share = np.maximum(share / share.max(axis=1, keepdims=True), floors[0])
        step = _weighted(J, qd_max**2 * share ** (2.0 - p), v, floors[1], times)
        qd = qd + (step - qd) / (p - 1.0)
    return qd


def penalised_bounds(q: Array, qd: Array, start: Array, bounds: tuple[Array, Array], penalty: float) -> Array:
    """Returns lower bounds (k,) on launch times to `qd` (k, 6) in postures `q` (n, 6), taken in turn."""
    v_max, a_max = bounds
    excess = largest_shares(qd, v_max)
    bound = _least_time(q[np.arange(len(qd)) % len(q)] - start, qd, v_max, a_max)
    return np.where(np.isnan(excess + bound), np.inf, np.where(excess <= 1.0, bound, penalty * excess))


def _least_time(distance: Array, qd: Array, v_max: Array, a_max: Array) -> Array:
    turn = np.where(distance >= qd * np.abs(qd) / (2.0 * a_max), 1.0, -1.0)
    d = turn * distance
    v = turn * qd
    peak = np.sqrt(np.maximum(a_max * d + v**2 / 2.0, 0.0))
    direct = (2.0 * peak - v) / a_max
    accelerating = (2.0 * v_max**2 - v**2) / (2.0 * a_max)
    cruising = (2.0 * v_max - v) / a_max + (d - accelerating) / v_max
    return np.where(peak <= v_max, direct, cruising).max(axis=-1)


def distinct_rows(q: Array, least: float, most: int) -> Index:
    """Returns the first `most` rows of `q` (n, 6) that differ in some joint by more than `least` from others."""
    kept: list[int] = []
    for i in range(len(q)):
        if len(kept) < most and (np.abs(q[kept] - q[i]) > least).any(axis=1).all():
            kept.append(i)
    return np.array(kept, dtype=np.intp)
