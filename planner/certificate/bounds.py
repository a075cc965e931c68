"""Bounds on a motion between samples: rates of the joints and of points, and proofs by bisection.

A point beyond joint m at a distance of at most r_m from the axes before it obeys (jerk constant in every tick)

    |p'|    <= sum r |qd|                           |p''|   <= sum r |qdd| + sum r |qd qd|
    |p'''|  <= sum r |j| + 3 sum r |qd qdd| + sum r |qd qd qd|
    |p''''| <= 4 sum r |qd j| + 3 sum r |qdd qdd| + 6 sum r |qd qd qdd| + sum r |qd qd qd qd|

where the lever r of a product is that of its outermost joint. Source: repeated differentiation of a chain of rotations;
each derivative of a rotation adds one factor, and a cross product never lengthens a vector by more.

Between two instants h apart, a function f with a continuous slope obeys f >= min(f0, f1) - sup|f''| h^2/8, and one that
changes no faster than L obeys f >= (f0 + f1 - L h)/2. Torques follow the joint accelerations, whose slope jumps with
the jerk from tick to tick: each jump counts (`kinked_bound`). `prove_above` bisects until one of these decides, and on
until the bound that it has proven is close to the least value found: what a certificate tells is a bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.native import loops
from planner.trajectory import Trajectory

ROUNDS = 16  # [-] bisections of an interval: 2^-16 of a coarse one is below a microsecond
EVALUATIONS_MAX = 40_000  # [-] of one check; a motion this close to a limit for this long is not certified
SHARPENED_MAX = 4_000  # [-] evaluations after which a bound that is proven is told as it is


class Rates:
    """Bounds on |qd|, |qdd| and |jerk| of n joints over each of m intervals, (n, m) each.

    Attributes:
        qd, qdd, jerk: the bounds (n, m) [rad/s, rad/s^2, rad/s^3].
        jumps: sums of the jumps of the joints' jerks inside the intervals, at their ends none (n, m) [rad/s^3].
        rows: all four (4, n, m).
        bounds: what follows from the first three (11, n, m): the next three attributes.
        sums: of the first three, over all joints up to and including each (3, n, m).
        totals: bounds on the first to fourth derivative of a direction fixed in the link beyond each joint (4, n, m).
        by_derivative: weights of the levers in the bounds on the first to fourth derivative of a point (4, n, m).
    """

    def __init__(self, rows: Array) -> None:
        """Takes the four rows (4, n, m)."""
        self.rows = rows
        self.bounds = loops.derivative_bounds(rows[:3])
        self.qd, self.qdd, self.jerk, self.jumps = rows
        self.sums = self.bounds[:3]
        self.totals = self.bounds[3:7]
        self.by_derivative = self.bounds[7:]


def joint_rates(trajectory: Trajectory, knots: Index | None = None) -> Rates:
    """Returns rate bounds of the joints between neighbouring `knots`.

    Args:
        trajectory: the motion.
        knots: increasing indices of samples (k,); all of them by default.
    """
    if knots is None:
        knots = np.arange(len(trajectory.q))
    return Rates(loops.joint_rates(trajectory.samples, trajectory.dt, knots))


def point_bound(lever: Array, rates: Rates, derivative: int) -> Array:
    """Returns bounds on a derivative of a point's position over every interval.

    Args:
        lever: of the point about each joint (6,) [m], or of k points (k, 6).
        rates: of the joints over m intervals.
        derivative: 1 for the speed [m/s] to 4 for the fourth derivative [m/s^4].

    Returns:
        (m,), or (k, m) of k points.
    """
    return lever @ rates.by_derivative[derivative - 1]


class Proof(NamedTuple):
    """Result of `prove_above`.

    Attributes:
        value: lower bound that holds at every instant; where that was not asked for, or nothing is proven, the smallest
            value found.
        at_s: time of the smallest value found [s].
        item: its item.
        proven: whether the required bound is proven for every instant.
    """

    value: float
    at_s: float
    item: int
    proven: bool


class Intervals(NamedTuple):
    """Intervals on which a bound is undecided.

    Attributes:
        left, right: their ends (k,) [s].
        f_left, f_right: values there (k,).
        rate: rate bound of the item on each (..., k).
        item: index of the item (k,).
    """

    left: Array
    right: Array
    f_left: Array
    f_right: Array
    rate: Array
    item: Index

    def keep(self, chosen: Mask) -> Intervals:
        """Returns the `chosen` intervals (k,)."""
        return Intervals._make(values[..., chosen] for values in self)

    def lower(self, lower_bound: LowerBound) -> Array:
        """Returns lower bounds on f over every interval (k,)."""
        return lower_bound(self.f_left, self.f_right, self.rate, self.right - self.left)

    def halves(self, middle: Array, f_middle: Array) -> Intervals:
        """Returns both halves of every interval."""
        first = self._replace(right=middle, f_right=f_middle)
        second = self._replace(left=middle, f_left=f_middle)
        return Intervals._make(np.concatenate(pair, axis=-1) for pair in zip(first, second, strict=True))


LowerBound = Callable[[Array, Array, Array, Array], Array]  # of values at both ends, rate and length of intervals


def slope_bound(f_left: Array, f_right: Array, rate: Array, h: Array) -> Array:
    """Returns lower bounds on f over intervals of length `h` with |f'| <= `rate`."""
    return (f_left + f_right - rate * h) / 2.0


def curvature_bound(f_left: Array, f_right: Array, rate: Array, h: Array) -> Array:
    """Returns lower bounds on f over intervals of length `h` with |f''| <= `rate`."""
    return np.minimum(f_left, f_right) - rate * (h * h / 8.0)


def kinked_bound(f_left: Array, f_right: Array, rates: Array, h: Array) -> Array:
    """Returns lower bounds on f over intervals of length `h` in which f' may jump.

    Between jumps |f''| <= rates[0]; the jumps add up to at most rates[1]. A jump d at a time s after the left end moves
    f from its chord by d s (h - s) / h, at most d h/4.
    """
    return np.minimum(f_left, f_right) - (rates[0] * (h / 8.0) + rates[1] / 4.0) * h


def prove_above(
    evaluate: Callable[[Array, Index], Array],
    knots: Array,
    values: Array,
    rates: Array,
    required: float,
    lower_bound: LowerBound,
    accuracy: float,
) -> Proof:
    """Proves f(t) >= `required` over [knots[0], knots[-1]] for every item by bisection, or finds a violation.

    Args:
        evaluate: function of times (k,) [s] and items (k,) that returns f (k,).
        knots: increasing times (m,) [s].
        values: f at the knots (items, m), or lower bounds on it where they are large enough.
        rates: rate bounds of every item on every interval (..., items, m-1) or (m-1,), as `lower_bound` takes them.
        required: the bound; -infinity asks for nothing.
        lower_bound: `slope_bound`, `curvature_bound` or `kinked_bound`.
        accuracy: by which the proven bound may be below the least value found; infinity asks for `required` alone.
    """
    item, knot = divmod(int(values.argmin()), values.shape[1])  # the first NaN, if there is one
    best = Proof(float(values[item, knot]), float(knots[knot]), item, False)
    if not best.value >= required:
        return best
    lower = lower_bound(values[:, :-1], values[:, 1:], rates, knots[1:] - knots[:-1])

    def intervals(chosen: Mask) -> Intervals:
        items, parts = np.nonzero(chosen)
        rate = np.broadcast_to(rates, (*rates.shape[:-2], *chosen.shape))[..., items, parts]
        return Intervals(knots[parts], knots[parts + 1], values[items, parts], values[items, parts + 1], rate, items)

    undecided = ~(lower >= required)
    found = _bisect(evaluate, intervals(undecided), best, required, lower_bound) if undecided.any() else best
    if undecided.any() and not found.proven:
        return found
    found = found._replace(proven=True)
    if accuracy == math.inf:
        return found
    loose = lower < found.value - accuracy
    least = float(lower[~loose].min(initial=found.value))
    found, bound = _sharpen(evaluate, intervals(loose), found, lower_bound, accuracy)
    return found._replace(value=max(required, min(least, bound)))


def _bisect(
    evaluate: Callable[[Array, Index], Array], todo: Intervals, best: Proof, required: float, lower_bound: LowerBound
) -> Proof:
    spent = 0
    for _ in range(ROUNDS):
        spent += len(todo.left)
        if spent > EVALUATIONS_MAX:
            return best
        todo, best = _halved(evaluate, todo, best)
        if not best.value >= required:
            return best
        todo = todo.keep(~(todo.lower(lower_bound) >= required))
        if len(todo.left) == 0:
            return best._replace(proven=True)
    return best


def _sharpen(
    evaluate: Callable[[Array, Index], Array], todo: Intervals, best: Proof, lower_bound: LowerBound, accuracy: float
) -> tuple[Proof, float]:
    """Returns the proof with the least value found, and a lower bound on f over `todo` that is close to it."""
    bound = best.value
    lower = todo.lower(lower_bound)
    spent = 0
    for _ in range(ROUNDS):
        spent += len(todo.left)
        if len(todo.left) == 0 or spent > SHARPENED_MAX:
            break
        todo, best = _halved(evaluate, todo, best)
        lower = todo.lower(lower_bound)
        loose = lower < best.value - accuracy
        bound = float(lower[~loose].min(initial=min(bound, best.value)))
        todo = todo.keep(loose)
        lower = lower[loose]
    return best, float(lower.min(initial=bound))


def _halved(evaluate: Callable[[Array, Index], Array], todo: Intervals, best: Proof) -> tuple[Intervals, Proof]:
    """Returns the halves of intervals, and the proof with the least of the values between them, if that is less."""
    middle = (todo.left + todo.right) / 2.0
    f_middle = evaluate(middle, todo.item)
    worst = int(f_middle.argmin())
    if not f_middle[worst] >= best.value:
        best = best._replace(value=float(f_middle[worst]), at_s=float(middle[worst]), item=int(todo.item[worst]))
    return todo.halves(middle, f_middle), best
