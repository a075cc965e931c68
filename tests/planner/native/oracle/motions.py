"""A motion between its samples: numpy twins of planner/native/kernel/bounds.c."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.native import Pinned


def states_at(t: Array, rate: float, samples: Pinned) -> Array:
    """Returns q, qd, qdd (3, k, n) at times `t` (k,) for all samples of q, qd, qdd and the jerk of every tick."""
    last = len(samples.arrays[0]) - 1
    t = np.clip(t, 0.0, last / rate)
    i = np.minimum((t * rate).astype(int), last - 1)
    s = (t - i / rate)[:, None]
    q, qd, qdd, jerk = (values[i] for values in samples.arrays)
    place = q + s * (qd + s * (qdd / 2.0 + s * jerk / 6.0))
    return np.array([place, qd + s * (qdd + s * jerk / 2.0), qdd + s * jerk])


def derivative_bounds(rates: Array) -> Array:
    """Returns sums, totals and weights (11, n, m) of `Rates` for bounds on |qd|, |qdd| and |jerk| (3, n, m)."""
    s, a, j = sums = np.cumsum(rates, axis=1)
    s2 = s * s
    totals = np.array([s, a + s2, j + 3 * s * a + s2 * s, 4 * s * j + 3 * a * a + 6 * s2 * a + s2 * s2])
    return np.concatenate([sums, totals, np.diff(totals, axis=1, prepend=0.0)])


def joint_rates(samples: Pinned, dt: float, knots: Index) -> Array:
    """Returns the rows of `Rates` between `knots` (k,), for q, qd, qdd (N, n) and the jerk of every tick (N-1, n)."""
    _, *rates, jerks = samples.arrays
    qd, qdd = (_largest_between(values, knots, True) for values in rates)
    jerk = _largest_between(jerks, knots, False)  # of a tick, which ends at the next sample
    jumps = np.zeros((knots[-1] + 1, len(qd)))
    jumps[1:-1] = np.abs(np.diff(jerks[: knots[-1]], axis=0))
    jumps[knots] = 0.0  # a jump at the end of an interval has no effect inside
    return np.array([qd + jerk * dt**2 / 8.0, qdd, jerk, np.add.reduceat(jumps, knots[:-1], axis=0).T])


def _largest_between(values: Array, rows: Index, closed: bool) -> Array:
    """Returns the largest sizes (c, k-1) of `values` (n, c) from each of `rows` (k,) to the next.

    The next row is among them if `closed`.
    """
    size = np.abs(values[rows[0] : rows[-1] + 1])
    inside = np.maximum.reduceat(size[: rows[-1] - rows[0]], rows[:-1] - rows[0])
    return (np.maximum(inside, size[rows[1:] - rows[0]]) if closed else inside).T


def joint_extremes(dt: float, samples: Pinned) -> Array:
    """Returns largest values and their ticks (2, 6, 6) for q, qd, qdd (N, 6) and the jerk of every tick (N-1, 6).

    They are those of -q, q, |qd|, |qdd|, |jerk| and of the disagreement of neighbouring samples. What is not finite is
    infinite.
    """
    q, qd, qdd, jerk = samples.arrays
    rows = (
        *_position_extrema(dt, q, qd, qdd, jerk),
        _speed_extrema(qd, qdd, jerk),
        np.abs(qdd),
        np.abs(jerk),
        _disagreement(dt, q, qd, qdd),
    )
    return np.array([_largest_of(values) for values in rows]).swapaxes(0, 1)


def _largest_of(values: Array) -> Array:
    """Returns the largest of `values` (k, n) and their first rows (2, n)."""
    values = np.where(np.isfinite(values), values, np.inf)
    return np.array([values.max(axis=0), values.argmax(axis=0)])


def _disagreement(dt: float, q: Array, qd: Array, qdd: Array) -> Array:
    """Returns by how much the state at the end of every tick (N-1, n) differs from that at its beginning."""
    speed = np.abs(np.diff(qd, axis=0) - dt * (qdd[:-1] + qdd[1:]) / 2.0)
    place = np.abs(np.diff(q, axis=0) - dt * (qd[:-1] + dt * (2.0 * qdd[:-1] + qdd[1:]) / 6.0))
    return np.maximum(speed, place)


def _speed_extrema(qd: Array, qdd: Array, jerk: Array) -> Array:
    """Returns the largest |qd| of every tick (N-1, n): at its ends, or at the vertex where qdd changes sign."""
    ends = np.maximum(np.abs(qd[:-1]), np.abs(qd[1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.abs(qd[:-1] - qdd[:-1] ** 2 / (2.0 * jerk))
    return np.where(qdd[:-1] * qdd[1:] < 0.0, np.maximum(ends, vertex), ends)


def _position_extrema(dt: float, q: Array, qd: Array, qdd: Array, jerk: Array) -> tuple[Array, Array]:
    """Returns the largest -q and q of every tick (N-1, n).

    A joint turns back inside a tick only where its velocity changes sign, or its acceleration does.
    """
    lowest = np.minimum(q[:-1], q[1:])
    highest = np.maximum(q[:-1], q[1:])
    turns = ~((qd[:-1] * qd[1:] > 0.0) & (qdd[:-1] * qdd[1:] >= 0.0))
    start = q[:-1][turns]
    v = qd[:-1][turns]
    a = qdd[:-1][turns]
    j = jerk[turns]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(a * a - 2.0 * j * v)
        s = np.array([(-a + root) / j, (-a - root) / j, -v / a])
    s = np.where(np.isfinite(s), np.clip(s, 0.0, dt), 0.0)
    turn = start + s * (v + s * (a / 2.0 + s * j / 6.0))
    lowest[turns] = np.minimum(lowest[turns], turn.min(axis=0))
    highest[turns] = np.maximum(highest[turns], turn.max(axis=0))
    return -lowest, highest


def load_bounds(rates: tuple[Array, Array], bodies: tuple[Array, ...], inertia: float, g: float) -> Array:
    """Returns the rows of `LoadBounds` (33, m): see there for the formulas.

    Args:
        rates: rows (4, 6, m) and their `derivative_bounds` (11, 6, m).
        bodies: levers and moment arms (8, 6), masses (8,), turned inertia (6,) and the bound of the mass matrix (6, 6).
        inertia: of all bodies.
        g: gravity.
    """
    (qd, _, _, jumps), bounds = rates
    lever, moment_arm, mass, turned, mass_matrix = bodies
    w1, w2, w3, w4 = (total[-1] for total in bounds[3:7])
    v, a, j, s = (lever @ weights for weights in bounds[7:])
    twice = 2.0 * (w2 + w1 * w1)
    arms = moment_arm.T
    turns = turned[:, None]
    jumping = mass_matrix @ jumps
    force = s + 4.0 * w1 * j + twice * (a + g)
    power = mass @ (j * (3.0 * a + g) + v * s) + inertia * (3.0 * w2 * w3 + w1 * w4)
    rows = (
        arms @ force + np.outer(turned, 2.0 * (w4 + 4.0 * w1 * w3 + twice * w2)),
        jumping,
        arms @ v + turns * w1,
        arms @ (a + 2.0 * w1 * v) + turns * (w2 + w1 * w1),
        arms @ (j + 4.0 * w1 * a + twice * v) + turns * (w3 + 3.0 * w1 * w2),
        (mass @ j)[None],
        power[None],
        (qd * jumping).sum(axis=0)[None],
    )
    return np.concatenate(rows)
