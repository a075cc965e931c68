"""Trajectories with one constant jerk per tick.

There is one sample per controller tick; between two samples the jerk of every joint is constant. So the samples
(q, qd, qdd) determine the motion exactly: inside a tick acceleration is linear, velocity quadratic and position cubic,
and every bound between samples has a closed form. See docs/decisions/0003.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, read_only
from planner.native import Pinned, loops


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint motion on the tick grid, from the start to standstill.

    Attributes:
        sample_rate_hz: ticks per second.
        q: positions (N, n) [rad]; sample i is at i / sample_rate_hz.
        qd: velocities (N, n) [rad/s].
        qdd: accelerations (N, n) [rad/s^2].
        release_index: sample at which the object leaves; the last one for a move that ends at rest, and that of the
            last passage for a motion that lets nothing go.
        passage_indices: samples of the passages, in their order; empty: there is one, at `release_index`.

    Raises:
        ValueError: the arrays have different shapes, or a release or passage is not a sample.
    """

    sample_rate_hz: float
    q: Array
    qd: Array
    qdd: Array
    release_index: int
    passage_indices: tuple[int, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for name in ("q", "qd", "qdd"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.q.ndim != 2 or not self.q.shape == self.qd.shape == self.qdd.shape or len(self.q) < 2:
            raise ValueError(f"q {self.q.shape}, qd {self.qd.shape}, qdd {self.qdd.shape} must be one (N >= 2, n)")
        if not 0 <= self.release_index < len(self.q):
            raise ValueError(f"release_index {self.release_index} is not a sample of {len(self.q)}")
        if any(not 0 <= index < len(self.q) for index in self.passage_indices):
            raise ValueError(f"passage_indices {self.passage_indices} are not samples of {len(self.q)}")

    @property
    def dt(self) -> float:
        """One tick [s]."""
        return 1.0 / self.sample_rate_hz

    @cached_property
    def t(self) -> Array:
        """Times of the samples (N,) [s]."""
        return np.arange(len(self.q)) / self.sample_rate_hz

    @property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return (len(self.q) - 1) / self.sample_rate_hz

    @property
    def release_time_s(self) -> float:
        """Time of the release [s]."""
        return self.release_index / self.sample_rate_hz

    @property
    def passed(self) -> tuple[int, ...]:
        """Samples of the passages, in their order."""
        return self.passage_indices or (self.release_index,)

    @cached_property
    def jerk(self) -> Array:
        """Constant jerk of every tick (N-1, n) [rad/s^3]."""
        return np.diff(self.qdd, axis=0) * self.sample_rate_hz

    @cached_property
    def samples(self) -> Pinned:
        """The arrays q, qd, qdd and jerk."""
        return Pinned(self.q, self.qd, self.qdd, self.jerk)

    def until(self, end: int) -> Trajectory:
        """Returns the motion up to a sample, not before its release; without passages of its own."""
        arrays = [each[: end + 1] for each in (self.q, self.qd, self.qdd)]
        return Trajectory(self.sample_rate_hz, *arrays, release_index=self.release_index)

    def since(self, begin: int) -> Trajectory:
        """Returns the motion from a sample on, not after its release; without passages of its own."""
        arrays = [each[begin:] for each in (self.q, self.qd, self.qdd)]
        return Trajectory(self.sample_rate_hz, *arrays, release_index=self.release_index - begin)

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Returns exact q, qd, qdd (..., n) at times `t` (...,) [s]; times outside [0, duration] are clipped to it."""
        t = np.asarray(t, float)
        found = loops.states_at(t.ravel(), float(self.sample_rate_hz), self.samples)
        q, qd, qdd = found.reshape(3, *t.shape, self.q.shape[1])
        return q, qd, qdd


def integrate(q0: ArrayLike, qd0: ArrayLike, qdd0: ArrayLike, jerk: Array, dt: float) -> tuple[Array, Array, Array]:
    """Returns q, qd, qdd (N+1, n) of piecewise-constant jerk from an initial state, exactly.

    Args:
        q0: initial positions (n,) [rad].
        qd0: initial velocities (n,) [rad/s].
        qdd0: initial accelerations (n,) [rad/s^2].
        jerk: of every tick (N, n) [rad/s^3].
        dt: one tick [s].
    """
    zero = np.zeros((1, jerk.shape[1]))
    qdd = np.asarray(qdd0, float) + np.concatenate([zero, np.cumsum(jerk, axis=0) * dt])
    qd_steps = dt * (qdd[:-1] + dt * jerk / 2.0)
    qd = np.asarray(qd0, float) + np.concatenate([zero, np.cumsum(qd_steps, axis=0)])
    q_steps = dt * (qd[:-1] + dt * (qdd[:-1] / 2.0 + dt * jerk / 6.0))
    q = np.asarray(q0, float) + np.concatenate([zero, np.cumsum(q_steps, axis=0)])
    return q, qd, qdd


def interpolate(q: Array, qd_first: Array, qd_last: Array, dt: float) -> tuple[Array, Array, Array]:
    """Returns q, qd, qdd (N+1, ...) of the motion of one jerk a tick through positions, with velocities at its ends.

    That is the clamped cubic spline: its velocities solve a tridiagonal system, here by Thomas' algorithm.

    Args:
        q: positions (N+1, ...) [rad].
        qd_first, qd_last: velocities at the ends (...) [rad/s].
        dt: one tick [s].
    """
    slope = np.diff(q, axis=0) / dt
    qd = np.concatenate([qd_first[None], 3.0 * (slope[:-1] + slope[1:]), qd_last[None]])
    share = np.zeros(len(q))
    for i in range(1, len(q) - 1):
        share[i] = 1.0 / (4.0 - share[i - 1])
        qd[i] = share[i] * (qd[i] - qd[i - 1])
    for i in range(len(q) - 2, 0, -1):
        qd[i] -= share[i] * qd[i + 1]
    after = (6.0 * slope - 4.0 * qd[:-1] - 2.0 * qd[1:]) / dt
    before = (2.0 * qd[-2:-1] + 4.0 * qd[-1:] - 6.0 * slope[-1:]) / dt
    return q, qd, np.concatenate([after, before])


def columns_at(t: Array, knots: Array, values: Array) -> Array:
    """Returns the columns of `values` (k, m) at times t (n,): linear between `knots` (k,), constant outside."""
    return np.stack([np.interp(t, knots, column) for column in values.T], axis=1)


def join(launch: tuple[Array, Array, Array], brake: tuple[Array, Array, Array], rate: float) -> Trajectory:
    """Returns the trajectory of a launch followed by a brake.

    Args:
        launch: q, qd, qdd (N, n) [rad, rad/s, rad/s^2].
        brake: the same quantities (M, n), starting in the launch's last state.
        rate: ticks per second [Hz].
    """
    arrays = [np.concatenate([head, tail[1:]]) for head, tail in zip(launch, brake, strict=True)]
    return Trajectory(rate, *arrays, release_index=len(launch[0]) - 1)


def in_a_row(first: Trajectory, second: Trajectory) -> Trajectory:
    """Returns two motions as one, without a pause: the second begins in the state in which the first ends.

    Raises:
        ValueError: their sample rates differ.
    """
    if first.sample_rate_hz != second.sample_rate_hz:
        raise ValueError(f"{first.sample_rate_hz:g} Hz and {second.sample_rate_hz:g} Hz are not one sample rate")
    arrays = [np.concatenate([getattr(first, name), getattr(second, name)[1:]]) for name in ("q", "qd", "qdd")]
    return Trajectory(first.sample_rate_hz, *arrays, release_index=len(first.q) - 1 + second.release_index)
