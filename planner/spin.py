"""Rotation of a body in flight: free of torque, as it has begun with the tool's angular velocity.

Its angular momentum stays. A body that is round about an axis u, with the moments I about it and J across, turns about
the fixed direction of its momentum with the rate P = w + (I / J - 1) (w . u) u, and by (1 - I / J) (w . u) about u in
itself: its motion is known in closed form. For any other body Euler's equations are integrated by the classical
fourth-order Runge-Kutta method. Source: Goldstein, Classical Mechanics (2002), sections 5.5 and 5.6.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array
from planner.rotations import quaternion_to_matrix, rotation_vector_to_matrix

EQUAL = 1e-9  # [-] moments of inertia that differ by less are those of a round body
STEP_RAD = 0.05  # [rad] of one Runge-Kutta step: the axes are off by less than 1e-7 rad a turn (see the tests)


def turned(R_WO: Array, w_W: Array, inertia: Array, times: Array, step_rad: float = STEP_RAD) -> Array:
    """Returns the axes (n, 3, 3) of n bodies in the world, each at its own time after its release.

    Args:
        R_WO: their axes at the release (n, 3, 3).
        w_W: their angular velocities there (n, 3) [rad/s].
        inertia: moments of inertia about these axes (3,) [kg m^2].
        times: [s] (n,).
        step_rad: of an integration [rad]; the error grows with its fourth power.
    """
    axis = round_axis(inertia)
    if axis is None:
        return _integrated(R_WO, w_W, inertia, times, step_rad)
    u = R_WO[:, :, axis]
    ratio = float(inertia[axis] / np.delete(inertia, axis)[0])
    along = (w_W * u).sum(axis=1)
    itself = np.zeros_like(w_W)
    itself[:, axis] = (1.0 - ratio) * along * times
    turn = rotation_vector_to_matrix(precession(u, w_W, ratio) * times[:, None])
    return turn @ R_WO @ rotation_vector_to_matrix(itself)


def precession(u: Array, w: Array, ratio: float) -> Array:
    """Returns the rates (n, 3) [rad/s] at which the axes of round bodies turn about their angular momentum.

    Args:
        u: their axes in the world (n, 3).
        w: their angular velocities (n, 3) [rad/s].
        ratio: of their moment of inertia about the axis and that across it [-].
    """
    return w + (ratio - 1.0) * (w * u).sum(axis=-1, keepdims=True) * u


def round_axis(inertia: Array) -> int | None:
    """Returns the axis about which a body with these moments of inertia (3,) turns as a round one; None without."""
    for axis in (2, 0, 1):
        one, other = np.delete(inertia, axis)
        if abs(one - other) <= EQUAL * one:
            return axis
    return None


def _integrated(R_WO: Array, w_W: Array, inertia: Array, times: Array, step_rad: float) -> Array:
    """Returns the axes (n, 3, 3) as `turned` does, by steps of equal length for each body.

    None turns faster than all its energy about the axis of the least moment would make it.
    """
    w = np.einsum("nij,ni->nj", R_WO, w_W)
    fastest = np.sqrt((inertia * w * w).sum(axis=1) / inertia.min())
    count = max(1, math.ceil(float(np.abs(fastest * times).max(initial=0.0)) / step_rad))
    h = (times / count)[:, None]
    state = np.concatenate([np.tile([0.0, 0.0, 0.0, 1.0], (len(w), 1)), w], axis=1)
    for _ in range(count):
        k1 = _rates(state, inertia)
        k2 = _rates(state + 0.5 * h * k1, inertia)
        k3 = _rates(state + 0.5 * h * k2, inertia)
        k4 = _rates(state + h * k3, inertia)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return R_WO @ quaternion_to_matrix(state[:, :4])


def _rates(state: Array, inertia: Array) -> Array:
    """Returns the derivatives (n, 7) of quaternions from the first axes, and of rates in the body's axes."""
    x, y, z, s = state[:, :4].T
    w = state[:, 4:]
    a, b, c = w.T
    turn = [s * a + y * c - z * b, s * b + z * a - x * c, s * c + x * b - y * a, -x * a - y * b - z * c]
    return np.column_stack([*(0.5 * each for each in turn), np.cross(inertia * w, w) / inertia])
