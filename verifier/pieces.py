"""A motion as pieces of time, over each of which joint coordinates are Taylor models.

Within a tick the jerk is constant (docs/decisions/0003), so that positions are cubics from the sample at its begin.
At its end they miss the next sample by the rounding of both: the motion is taken as any one that is no farther from the
cubics than they miss, which the bounds of the models hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from verifier.elementary import ROUNDING, Array, Index, Mask
from verifier.plan_document import SampledMotion
from verifier.taylor import COEFFICIENT, UP, TaylorModel


@dataclass(frozen=True, eq=False)
class Pieces:
    """n pieces of a motion, each within a tick.

    Attributes:
        motion: the motion.
        tick: number of the tick of each (n,).
        begin, end: where in the tick each begins and ends (n,), as shares of it.
    """

    motion: SampledMotion
    tick: Index
    begin: Array
    end: Array

    @property
    def middle_s(self) -> Array:
        """Times (n,) of the middles [s], to rounding: to tell where something is."""
        return (self.tick + 0.5 * (self.begin + self.end)) / self.motion.rate_hz

    @property
    def times(self) -> TaylorModel:
        """Times (n,) [s]."""
        middle = (self.tick + 0.5 * (self.begin + self.end)) / self.motion.rate_hz
        half = 0.5 * (self.end - self.begin) / self.motion.rate_hz
        return TaylorModel(middle, half, np.zeros_like(half), 8.0 * ROUNDING * (middle + half))

    def chosen(self, which: Mask | Index) -> Pieces:
        """Returns some of the pieces."""
        return Pieces(self.motion, self.tick[which], self.begin[which], self.end[which])

    def halves(self) -> Pieces:
        """Returns both halves of every piece: first all first ones."""
        middle = 0.5 * (self.begin + self.end)
        begin, end = np.concatenate([self.begin, middle]), np.concatenate([middle, self.end])
        return Pieces(self.motion, np.tile(self.tick, 2), begin, end)

    @cached_property
    def joints(self) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
        """Positions, velocities and accelerations of the joints (6, n) [rad, rad/s, rad/s^2]."""
        return _joints(self)


def all_pieces(motion: SampledMotion) -> Pieces:
    """Returns the whole motion: its ticks."""
    count = len(motion.q) - 1
    return Pieces(motion, np.arange(count), np.zeros(count), np.ones(count))


def instant(motion: SampledMotion, index: int) -> Pieces:
    """Returns a sample as a piece that does not last."""
    tick = min(index, len(motion.q) - 2)
    at = np.array([float(index - tick)])
    return Pieces(motion, np.array([tick]), at, at)


def misses(motion: SampledMotion) -> Array:
    """Returns by how much positions, velocities, accelerations miss the next sample, at most (3, N - 1, 6)."""
    h = 1.0 / motion.rate_hz
    q, qd, qdd = (x[:-1] for x in (motion.q, motion.qd, motion.qdd))
    change = motion.qdd[1:] - qdd
    end_q = q + h * qd + h * h * (qdd / 2.0 + change / 6.0)
    end_qd = qd + h * (qdd + change / 2.0)
    sizes = np.abs(q) + h * np.abs(qd) + h * h * (np.abs(qdd) + np.abs(change))
    speeds = np.abs(qd) + h * (np.abs(qdd) + np.abs(change))
    off_q = np.abs(end_q - motion.q[1:]) + COEFFICIENT * (sizes + np.abs(motion.q[1:]))
    off_qd = np.abs(end_qd - motion.qd[1:]) + COEFFICIENT * (speeds + np.abs(motion.qd[1:]))
    return np.array([off_q, off_qd, COEFFICIENT * (np.abs(qdd) + np.abs(change))]) * UP


def jerks(motion: SampledMotion) -> Array:
    """Returns the jerks of the ticks (N - 1, 6) [rad/s^3], off by no more than `COEFFICIENT` of the terms' sizes."""
    return (motion.qdd[1:] - motion.qdd[:-1]) * motion.rate_hz


def _joints(pieces: Pieces) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
    """Returns the models of positions, velocities and accelerations: Taylor series about the middle of each piece."""
    motion = pieces.motion
    k = pieces.tick
    q, qd, qdd = (x[k].T for x in (motion.q, motion.qd, motion.qdd))
    jerk = jerks(motion)[k].T
    off_q, off_qd, off_qdd = misses(motion)[:, k].transpose(0, 2, 1)
    m = 0.5 * (pieces.begin + pieces.end) / motion.rate_hz
    h = 0.5 * (pieces.end - pieces.begin) / motion.rate_hz
    a = qdd + m * jerk
    v = qd + m * (qdd + m * jerk / 2.0)
    x = q + m * (qd + m * (qdd / 2.0 + m * jerk / 6.0))
    # Sizes of all terms of the sums above, beyond what they add up to.
    size_a = np.abs(qdd) + np.abs(motion.qdd[k + 1].T)
    size_v = np.abs(qd) + (m + h) * size_a
    size_x = np.abs(q) + (m + h) * size_v
    zero = np.zeros_like(a)
    models = (
        (x, h * v, h * h * a / 2.0, np.abs(h * h * h * jerk / 6.0) + off_q + COEFFICIENT * size_x),
        (v, h * a, h * h * jerk / 2.0, off_qd + COEFFICIENT * size_v),
        (a, h * jerk, zero, off_qdd + COEFFICIENT * size_a * 4.0),
    )
    position, velocity, acceleration = (TaylorModel(c0, c1, c2, r * UP) for c0, c1, c2, r in models)
    return position, velocity, acceleration
