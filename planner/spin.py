"""Rotation of a body in flight: free of torque, as it has begun with the tool's angular velocity.

Its angular momentum stays. A body that is round about an axis u, with the moments I about it and J across, turns about
the fixed direction of its momentum with the rate P = w + (I / J - 1) (w . u) u, and by (1 - I / J) (w . u) about u in
itself: its motion is known in closed form. For any other body Euler's equations are integrated by the classical
fourth-order Runge-Kutta method. Source: Goldstein, Classical Mechanics (2002), sections 5.5 and 5.6.

Euler's equations are w1' = -k1 w2 w3, w2' = k2 w3 w1, w3' = -k3 w1 w2 for moments I1 <= I2 <= I3, with k1 = (I3 - I2) /
I1, k2 = (I3 - I1) / I2 and k3 = (I2 - I1) / I3. No moment of a body is more than the other two together, so that each k
is at most 1. Then k1 / k2 <= 2, k3 / k2 <= 1, and k2 is at most 4 times the larger of k1 and k3; with the constants
k2 w1^2 + k1 w2^2 and k3 w2^2 + k2 w3^2 of the motion, no body ever turns faster than sqrt(5) times as fast as it began.
That bounds the steps of an integration, however near to a round body's its moments are.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array, Index
from planner.rotations import quaternion_to_matrix, rotation_vector_to_matrix

EQUAL = 1e-9  # [-] moments of inertia that differ by less are those of a round body
STEP_RAD = 0.1  # [rad] of one Runge-Kutta step at most: the axes are off by less than 1e-7 rad a turn (see the tests)
FASTEST = math.sqrt(5.0)  # [-] angular velocity of a body in flight over that at its release, see above
SCALES = np.geomspace(1.0, 1e4, 25)  # [-] of one coordinate over another, tried for the bound of `growth`


class Rotation:
    """How n bodies with the same moments of inertia turn after their releases."""

    def __init__(self, R_WO: Array, w_W: Array, inertia: Array, until_s: float, step_rad: float = STEP_RAD) -> None:
        """Takes the releases.

        Args:
            R_WO: axes of the bodies in the world (n, 3, 3).
            w_W: their angular velocities (n, 3) [rad/s].
            inertia: moments of inertia about these axes (3,) [kg m^2].
            until_s: time after the release for which they are known [s].
            step_rad: of an integration [rad]; the error grows with its fourth power.
        """
        self._R_WO = R_WO
        self._w_W = w_W
        self._inertia = inertia
        self._axis = round_axis(inertia)
        if self._axis is None:
            w = np.einsum("nij,ni->nj", R_WO, w_W)
            most = FASTEST * float(np.sqrt((w * w).sum(axis=1)).max(initial=0.0))
            count = max(1, math.ceil(most * until_s / step_rad))
            self._h = max(until_s, 1e-3) / count
            states = [np.concatenate([np.tile([[0.0], [0.0], [0.0], [1.0]], len(w)), w.T])]
            for _ in range(count):
                states.append(_stepped(states[-1], self._h, inertia))
            self._states = np.array(states)

    def axes(self, which: Index, s: Array) -> Array:
        """Returns the axes (k, 3, 3) in the world of bodies (k,) at times (k,) [s] after the release, or just before.

        Beyond the time for which they are known they stay.
        """
        R_WO = self._R_WO[which]
        if self._axis is None:
            node = np.clip(np.floor(s / self._h), 0, len(self._states) - 1).astype(np.intp)
            rest = np.minimum(s - node * self._h, self._h)
            state = _stepped(self._states[node, :, which].T, rest, self._inertia)
            return R_WO @ quaternion_to_matrix(state[:4].T)
        w_W = self._w_W[which]
        u = R_WO[:, :, self._axis]
        ratio = spin_ratio(self._inertia, self._axis)
        itself = np.zeros_like(w_W)
        itself[:, self._axis] = (1.0 - ratio) * (w_W * u).sum(axis=1) * s
        turn = rotation_vector_to_matrix(precession(u, w_W, ratio) * s[:, None])
        return turn @ R_WO @ rotation_vector_to_matrix(itself)


def turned(R_WO: Array, w_W: Array, inertia: Array, times: Array, step_rad: float = STEP_RAD) -> Array:
    """Returns the axes (n, 3, 3) of n bodies in the world, each at its own time (n,) after its release [s].

    The other arguments are those of `Rotation`.
    """
    rotation = Rotation(R_WO, w_W, inertia, float(times.max(initial=0.0)), step_rad)
    return rotation.axes(np.arange(len(times)), times)


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


def spin_ratio(inertia: Array, axis: int) -> float:
    """Returns the moment of inertia about the axis of a round body, over that across it [-]."""
    return float(inertia[axis] / np.delete(inertia, axis)[0])


def fastest_turn(inertia: Array, w: float) -> float:
    """Returns a bound on the angular velocity [rad/s] in flight of a body that begins with `w` [rad/s]."""
    return w if round_axis(inertia) is not None else FASTEST * w


def growth(inertia: Array, w: float, s: float) -> float:
    """Returns by how much a body is turned at most [s] for each change of its angular velocity at the release.

    A round body turns by two rotations at constant rates, which are linear in its angular velocity. Otherwise a small
    change x of w obeys x' = J x with the Jacobian J of Euler's equations, so that it grows by no more than exp(m s)
    with the logarithmic norm m of J, and the body turns by its integral. The norm may scale the coordinates, for which
    the change then grows by at most the ratio of the scales beside: several are tried, any of them is a bound. The
    symmetric part of J has no diagonal, and its entries are at most e w / 2: no eigenvalue exceeds e w / sqrt(3).

    Args:
        inertia: moments of inertia (3,) [kg m^2].
        w: angular velocity at the release, at most [rad/s].
        s: time from the release, at most [s].
    """
    axis = round_axis(inertia)
    if axis is not None:
        ratio = spin_ratio(inertia, axis)
        return s * (max(1.0, ratio) + abs(1.0 - ratio))
    least, middle, most = np.sort(inertia).tolist()
    k1, k2, k3 = (most - middle) / least, (most - least) / middle, (middle - least) / most
    one, three = np.meshgrid(SCALES, SCALES)  # of the first and of the third coordinate over the second
    entries = (np.abs(k2 / one - k1 * one), np.abs(k2 / three - k3 * three), k1 * one / three + k3 * three / one)
    rate = np.max(entries, axis=0) / math.sqrt(3.0) * fastest_turn(inertia, w)
    with np.errstate(over="ignore"):  # infinity is a bound, too
        grown = np.where(rate * s > 1e-9, np.expm1(rate * s) / np.maximum(rate, 1e-300), s)
        return float((np.maximum(one, three) * grown).min())


def _stepped(state: Array, h: Array | float, inertia: Array) -> Array:
    """Returns the states (7, n), quaternion and rates, one Runge-Kutta step of `h` [s] later."""
    k1 = _rates(state, inertia)
    k2 = _rates(state + 0.5 * h * k1, inertia)
    k3 = _rates(state + 0.5 * h * k2, inertia)
    k4 = _rates(state + h * k3, inertia)
    return state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def _rates(state: Array, inertia: Array) -> Array:
    """Returns the derivatives (7, n) of quaternions from the first axes, and of rates in the body's axes."""
    x, y, z, s, a, b, c = state
    i, j, k = inertia.tolist()
    found = np.empty_like(state)
    found[0] = 0.5 * (s * a + y * c - z * b)
    found[1] = 0.5 * (s * b + z * a - x * c)
    found[2] = 0.5 * (s * c + x * b - y * a)
    found[3] = -0.5 * (x * a + y * b + z * c)
    found[4] = (j - k) / i * b * c
    found[5] = (k - i) / j * c * a
    found[6] = (i - j) / k * a * b
    return found
