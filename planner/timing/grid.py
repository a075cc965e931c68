"""Bringing a motion onto the tick grid without losing its end state.

A solver's jerk switches where it likes; a trajectory's jerk switches on ticks. Taking the solver's accelerations at
the ticks gives every tick its mean jerk, which is within the bound, but moves the end of the phase by about
jerk dt^2 / 4 in velocity for each switch. The least change of the jerks that puts the end state back is added,
weighted so that it falls where the jerk has room. `grid_limits` is what a solver must keep free for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.cell import Limits
from planner.trajectory import integrate

Vector = NDArray[np.float64]
State = tuple[ArrayLike, ArrayLike, ArrayLike]

ACCELERATION_ROOM = 75.0  # [1/s^2] share of the acceleration limit left free, by dt^2: 3e-4 at 500 Hz, 5e-3 at 125 Hz
JERK_ROOM = 0.5  # [1/s^2] likewise of the jerk (both measured over random launches: docs/decisions/0002)
ROOMS = (1.0, 30.0, 1000.0)  # [-] multiples of the two tried in turn: a phase of few ticks, all saturated, needs more
FIT_TOLERANCE = 5e-8  # [-] share of a limit by which a phase may exceed it and still counts as fitting
JERK_FLOOR = 1e-3  # [-] least weight of a tick, so that a jerk saturated in every tick can still be corrected
PASSES = 2  # the second pass removes what rounding left of the first


def grid_limits(limits: Limits, dt: float, room: float = 1.0) -> Limits:
    """Returns `limits` less what the projection onto ticks of `dt` [s] may add to velocity, acceleration and jerk.

    A velocity plateau entered between two ticks is overshot by at most jerk_max dt^2 / 4. `room` is one of `ROOMS`.
    """
    share = min(room * dt**2, 1e-3)
    qd_max = np.maximum(limits.qd_max - limits.jerk_max * dt**2 / 4.0, 0.98 * limits.qd_max)
    qdd_max = limits.qdd_max * (1.0 - min(ACCELERATION_ROOM * share, 0.02))
    return replace(limits, qd_max=qd_max, qdd_max=qdd_max, jerk_max=limits.jerk_max * (1.0 - JERK_ROOM * share * 20.0))


def fits(phase: tuple[Vector, Vector, Vector], limits: Limits, dt: float) -> bool:
    """Returns whether the samples (q, qd, qdd) of a phase keep the limits on velocity, acceleration and jerk."""
    _, qd, qdd = phase
    jerk = np.diff(qdd, axis=0) / dt
    pairs = ((qd, limits.qd_max), (qdd, limits.qdd_max), (jerk, limits.jerk_max))
    return all(bool(np.all(np.abs(x) <= bound * (1.0 + FIT_TOLERANCE))) for x, bound in pairs)


def onto_grid(start: State, end: State, qdd: Vector, dt: float, jerk_max: Vector) -> tuple[Vector, Vector, Vector]:
    """Returns samples q, qd, qdd (N+1, n) from `start` exactly to `end`, close to the accelerations `qdd`.

    Args:
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (n,).
        end: likewise.
        qdd: the solver's accelerations at the ticks (N+1, n) [rad/s^2]; its first and last rows are not used.
        dt: one tick [s].
        jerk_max: (n,) [rad/s^3], where the correction finds room.
    """
    a = np.array(qdd, float)
    a[0], a[-1] = start[2], end[2]
    jerk = np.diff(a, axis=0) / dt
    kernel = _end_state_by_jerk(len(jerk), dt)
    for _ in range(PASSES):
        q, qd, acc = integrate(*start, jerk, dt)
        error = np.array([end[2] - acc[-1], end[1] - qd[-1], end[0] - q[-1]])
        jerk = jerk + _least_correction(kernel, error, jerk, jerk_max)
    q, qd, acc = integrate(*start, jerk, dt)
    for samples, target in zip((q, qd, acc), end, strict=True):
        samples[-1] = target
    return q, qd, acc


def _end_state_by_jerk(n: int, dt: float) -> Vector:
    """Returns the derivative (3, n) of the end's acceleration, velocity and position by the jerk of each tick."""
    rest = np.arange(n - 1, -1, -1) * dt
    return np.array([np.full(n, dt), dt * (rest + dt / 2), dt * (rest**2 / 2 + rest * dt / 2 + dt**2 / 6)])


def _least_correction(kernel: Vector, error: Vector, jerk: Vector, jerk_max: Vector) -> Vector:
    """Returns the weighted least-norm jerks (N, n) whose effect on the end state is `error` (3, n)."""
    weight = np.maximum(1.0 - np.abs(jerk) / jerk_max, JERK_FLOOR)
    scale = np.abs(kernel).sum(axis=1)
    rows = kernel / scale[:, None]
    pairs = (rows[:, None] * rows[None]).reshape(-1, rows.shape[1])
    gram = (pairs @ weight).T.reshape(-1, len(rows), len(rows))
    multipliers = np.linalg.solve(gram, (error / scale[:, None]).T[..., None])[..., 0]
    return weight * (rows.T @ multipliers.T)
