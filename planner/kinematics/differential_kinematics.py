"""Differential kinematics: joint velocities to twists and back, for any number of joints and rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array

# [1] share of the largest singular value below which one counts as zero in the undamped pseudo-inverse: far above the
# rounding of a Jacobian (1e-16), far below any that an arm could use
RANK_TOLERANCE = 1e-10


def forward_velocity(J: ArrayLike, qd: ArrayLike) -> Array:
    """Returns the twist (..., m) of joint velocities (..., n) through a Jacobian (..., m, n)."""
    return np.einsum("...mn,...n->...m", np.asarray(J, dtype=np.float64), np.asarray(qd, dtype=np.float64))


def inverse_velocity(J: ArrayLike, twist: ArrayLike, damping: float = 0.0, weights: ArrayLike | None = None) -> Array:
    """Returns the joint velocities (..., n) [rad/s] of a twist (..., m) through a Jacobian (..., m, n).

    For a square Jacobian without damping and weights this is the exact solution; otherwise the minimiser of
    |J qd - twist|^2 + damping^2 qd^T W qd, and of qd^T W qd among all minimisers if `damping` is zero.
    Source: Wampler 1986 and Nakamura and Hanafusa 1986 (damped least squares), Whitney 1969 (weights).

    Args:
        J: Jacobian (..., m, n).
        twist: (..., m).
        damping: trades accuracy for small velocities near a singularity, in units of J's singular values.
        weights: cost of each joint's velocity (n,), the diagonal of W, positive.

    Raises:
        ValueError: the damping is negative, or a weight is not positive.
        numpy.linalg.LinAlgError: exact solution of a singular Jacobian.
    """
    J = np.asarray(J, dtype=np.float64)
    twist = np.asarray(twist, dtype=np.float64)
    if damping < 0.0:
        raise ValueError(f"damping is {damping}, it must not be negative")
    if J.shape[-2] == J.shape[-1] and damping == 0.0 and weights is None:
        return np.asarray(np.linalg.solve(J, twist[..., None])[..., 0], dtype=np.float64)
    scale = _root_weights(weights, J.shape[-1])
    U, s, Vt = np.linalg.svd(J / scale, full_matrices=False)
    along = np.einsum("...mk,...m->...k", U, twist) * _inverted(s, damping)
    return np.einsum("...kn,...k->...n", Vt, along) / scale


def _root_weights(weights: ArrayLike | None, count: int) -> Array:
    values = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
    if not np.all(values > 0.0):
        raise ValueError(f"weights are {values.tolist()}, all must be positive")
    return np.sqrt(values)


def _inverted(s: Array, damping: float) -> Array:
    """Returns the inverses of singular values: damped, or zero for those that count as zero."""
    if damping > 0.0:
        return s / (s**2 + damping**2)
    usable = s > RANK_TOLERANCE * s[..., :1]
    return np.divide(1.0, s, out=np.zeros_like(s), where=usable)
