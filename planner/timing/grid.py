"""Projection of a motion onto the tick grid; its end state stays exact.

A solver switches the jerk at any time, a trajectory on ticks only. The solver's accelerations at the ticks give every
tick its mean jerk, which is within the bound, but each switch moves the end of the phase by about jerk dt^2 / 4 in
velocity. The smallest change of the jerks that restores the end state is added, weighted towards ticks whose jerk is
below its bound. `grid_limits` gives the tighter limits that a solver has to keep for it. See docs/decisions/0003.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.cell import Limits
from planner.trajectory import integrate

State = tuple[ArrayLike, ArrayLike, ArrayLike]

ACCELERATION_RESERVE = 75.0  # [1/s^2] share of the acceleration limit by dt^2: 3e-4 at 500 Hz; measured, decision 3
JERK_RESERVE = 10.0  # [1/s^2] share of the jerk limit by dt^2: 4e-5 at 500 Hz; measured, decision 3
SHARE_MAX = 1e-3  # [s^2] largest product of reserve factor and dt^2
ACCELERATION_RESERVE_MAX = 0.02  # [-] of the limit
VELOCITY_SHARE_MIN = 0.98  # [-] of the velocity limit that always stays usable
RESERVES = (1.0, 30.0, 1000.0)  # [-] factors tried in turn: a phase of few ticks, all saturated, needs a larger reserve
FIT_TOLERANCE = 5e-8  # [-] share of a limit by which a phase may exceed it; above the rounding of the projection
JERK_FLOOR = 1e-3  # [-] least weight of a tick, so that a phase with saturated jerk throughout can still be corrected
PASSES = 2  # the second pass removes the rounding error of the first
LENGTHS_KEPT = 256  # numbers of ticks whose derivatives are cached, up to 13 kB each for the second that a phase takes


def grid_limits(limits: Limits, dt: float, reserve: float = 1.0) -> Limits:
    """Returns tighter limits on velocity, acceleration and jerk that leave a reserve for the projection onto ticks.

    A velocity plateau entered between two ticks is overshot by at most jerk_max dt^2 / 4.

    Args:
        limits: to keep after the projection.
        dt: one tick [s].
        reserve: factor on the reserve [-], one of `RESERVES`.
    """
    share = min(reserve * dt**2, SHARE_MAX)
    qd_max = np.maximum(limits.qd_max - limits.jerk_max * dt**2 / 4.0, VELOCITY_SHARE_MIN * limits.qd_max)
    qdd_max = limits.qdd_max * (1.0 - min(ACCELERATION_RESERVE * share, ACCELERATION_RESERVE_MAX))
    return replace(limits, qd_max=qd_max, qdd_max=qdd_max, jerk_max=limits.jerk_max * (1.0 - JERK_RESERVE * share))


def fits(phase: tuple[Array, Array, Array], limits: Limits, dt: float) -> bool:
    """Returns whether the samples of a phase keep the limits on velocity, acceleration and jerk.

    Args:
        phase: q, qd, qdd (N+1, n) [rad, rad/s, rad/s^2].
        limits: to keep.
        dt: one tick [s].
    """
    _, qd, qdd = phase
    jerk = np.diff(qdd, axis=0) / dt
    pairs = ((qd, limits.qd_max), (qdd, limits.qdd_max), (jerk, limits.jerk_max))
    return all(bool(np.all(np.abs(x) <= bound * (1.0 + FIT_TOLERANCE))) for x, bound in pairs)


def onto_grid(start: State, end: State, qdd: Array, dt: float, jerk_max: Array) -> tuple[Array, Array, Array]:
    """Returns samples q, qd, qdd (N+1, n) from `start` exactly to `end`, close to the accelerations `qdd`.

    Args:
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (n,).
        end: the same quantities at the end.
        qdd: the solver's accelerations at the ticks (N+1, n) [rad/s^2]; the first and last rows are not used.
        dt: one tick [s].
        jerk_max: jerk limits (n,) [rad/s^3], which weight the correction.
    """
    a = np.array(qdd, float)
    a[0] = start[2]
    a[-1] = end[2]
    jerk = np.diff(a, axis=0) / dt
    by_jerk = _EndStateByJerk.over(len(jerk), dt)
    wanted = by_jerk.wanted(start, end)
    for _ in range(PASSES):
        jerk = jerk + by_jerk.least_correction(wanted - by_jerk.rows @ jerk, jerk, jerk_max)
    q, qd, acc = integrate(*start, jerk, dt)
    for samples, target in zip((q, qd, acc), end, strict=True):
        samples[-1] = target
    return q, qd, acc


@dataclass(frozen=True, eq=False)
class _EndStateByJerk:
    """What the jerks of N ticks add to the end's acceleration, velocity and position: linear, so no pass integrates.

    Attributes:
        duration_s: of the ticks [s].
        scale: sum of each derivative over the ticks (3, 1).
        rows: the derivatives (3, N) by the jerk of each tick, over `scale`.
        pairs: products of each two rows (9, N).
    """

    duration_s: float
    scale: Array
    rows: Array
    pairs: Array

    @staticmethod
    @lru_cache(maxsize=LENGTHS_KEPT)
    def over(n: int, dt: float) -> _EndStateByJerk:
        """Returns the derivatives over `n` ticks of `dt` [s]."""
        rest = np.arange(n - 1, -1, -1) * dt
        rows = np.array([np.full(n, dt), dt * (rest + dt / 2), dt * (rest**2 / 2 + rest * dt / 2 + dt**2 / 6)])
        scale = rows.sum(axis=1, keepdims=True)
        rows = rows / scale
        return _EndStateByJerk(n * dt, scale, rows, (rows[:, None] * rows[None]).reshape(-1, n))

    def wanted(self, start: State, end: State) -> Array:
        """Returns what the jerks have to add (3, n), over `scale`: the end less where `start` leads without jerk."""
        (q, qd, qdd) = (np.asarray(x, dtype=np.float64) for x in start)
        T = self.duration_s
        without_jerk = np.array([qdd, qd + T * qdd, q + T * (qd + T * qdd / 2.0)])
        return (np.array(end[::-1], dtype=np.float64) - without_jerk) / self.scale

    def least_correction(self, missing: Array, jerk: Array, jerk_max: Array) -> Array:
        """Returns the weighted least-norm jerks (N, n) that add `missing` (3, n), over `scale`."""
        weight = np.maximum(1.0 - np.abs(jerk) / jerk_max, JERK_FLOOR)
        gram = (self.pairs @ weight).T.reshape(-1, 3, 3)
        multipliers = np.linalg.solve(gram, missing.T[..., None])[..., 0]
        return weight * (self.rows.T @ multipliers.T)
