"""How far a motion can stray between two instants: bounds on speed, acceleration, jerk and snap of its points.

A point beyond joint m at distance at most r_m from the axes before it obeys (jerk constant inside a tick)

    |p'|    <= sum r |qd|                           |p''|   <= sum r |qdd| + sum r |qd qd|
    |p'''|  <= sum r |j| + 3 sum r |qd qdd| + sum r |qd qd qd|
    |p''''| <= 4 sum r |qd j| + 3 sum r |qdd qdd| + 6 sum r |qd qd qdd| + sum r |qd qd qd qd|

where the lever r of a product is that of the outermost joint in it. Source: repeated differentiation of a chain of
rotations; each derivative of a rotation costs one factor, and a cross product never lengthens a vector by more.
A smooth function f then obeys f >= min(f0, f1) - sup|f''| h^2/8 between two instants h apart, and a function that
changes no faster than L obeys f >= (f0 + f1 - L h)/2. `prove_above` bisects until one of them decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.robots import Robot
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

ROUNDS = 16  # bisections of one interval: 2^16 parts of a coarse interval are below a microsecond
EVALUATIONS_MAX = 40_000  # of one check; a motion this close to a limit for this long is not certified


class Rates:
    """Bounds on |qd|, |qdd|, |jerk| of each joint over each of m stretches of time, (m, n) each.

    The products of them that bound a point's derivatives are sorted by their outermost joint, once for all points.
    """

    def __init__(self, qd: Vector, qdd: Vector, jerk: Vector) -> None:
        self.qd, self.qdd, self.jerk = qd, qdd, jerk
        self._sums = [np.cumsum(x, axis=1) for x in (qd, qdd, jerk)]

    def between(self, knots: NDArray[np.intp]) -> Rates:
        """Returns the largest between neighbouring `knots` (k,), which count the stretches' ends."""
        rows = slice(0, knots[-1])
        return Rates(*(np.maximum.reduceat(x[rows], knots[:-1], axis=0) for x in (self.qd, self.qdd, self.jerk)))

    @cached_property
    def by_derivative(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Weights (m, n) of the levers in the bounds on first to fourth derivative of a point."""
        s, a, j = self._sums
        totals = (s, a + s * s, j + 3 * s * a + s**3, 4 * s * j + 3 * a * a + 6 * s * s * a + s**4)
        return tuple(np.diff(total, axis=1, prepend=0.0) for total in totals)  # pyright: ignore[reportReturnType]

    @property
    def totals(self) -> tuple[Vector, Vector, Vector]:
        """Sums over the joints (m,) of |qd|, |qdd|, |jerk|."""
        return self._sums[0][:, -1], self._sums[1][:, -1], self._sums[2][:, -1]


def joint_rates(trajectory: Trajectory) -> Rates:
    """Returns what the joints do at most inside every tick."""
    jerk = np.abs(trajectory.jerk)
    qd = np.maximum(np.abs(trajectory.qd[:-1]), np.abs(trajectory.qd[1:])) + jerk * trajectory.dt**2 / 8.0
    qdd = np.maximum(np.abs(trajectory.qdd[:-1]), np.abs(trajectory.qdd[1:]))
    return Rates(qd, qdd, jerk)


def levers(robot: Robot, frame: int, reach: float) -> Vector:
    """Returns for each joint (6,) how far a point within `reach` [m] of DH frame `frame`'s origin is from its axis.

    The offset d of a joint's own link lies along its axis and does not count; joints after `frame` do not move it.
    """
    own = np.abs(robot.a)
    beyond = np.hypot(robot.a, robot.d)
    lever = np.zeros(6)
    for j in range(frame):
        lever[j] = own[j] + beyond[j + 1 : frame].sum() + reach
    return lever


def point_speed(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest speed of the point over every stretch (m,) [m/s]."""
    return rates.by_derivative[0] @ _not_growing(lever)


def point_acceleration(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest acceleration over every stretch (m,) [m/s^2], or (m, k) of k points with levers (k, 6)."""
    return rates.by_derivative[1] @ _not_growing(lever).T


def point_jerk(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest jerk of the point over every stretch (m,) [m/s^3]."""
    return rates.by_derivative[2] @ _not_growing(lever)


def point_snap(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest fourth derivative of the point over every stretch (m,) [m/s^4]."""
    return rates.by_derivative[3] @ _not_growing(lever)


def _not_growing(lever: Vector) -> Vector:
    """Returns the largest lever not before each joint: levers fall towards the tool, rounding aside."""
    return np.maximum.accumulate(lever[..., ::-1], axis=-1)[..., ::-1]


@dataclass(frozen=True)
class Proof:
    """The smallest value met, when [s], on which item, and whether the bound is proven for every instant."""

    value: float
    at_s: float
    item: int
    proven: bool


@dataclass(frozen=True, eq=False)
class Intervals:
    """Stretches of time on which a bound is undecided: ends [s], values at the ends, rate bound, item; each (k,)."""

    left: Vector
    right: Vector
    f_left: Vector
    f_right: Vector
    rate: Vector
    item: NDArray[np.intp]

    def keep(self, chosen: NDArray[np.bool_]) -> Intervals:
        """Returns the chosen ones."""
        return Intervals(
            self.left[chosen],
            self.right[chosen],
            self.f_left[chosen],
            self.f_right[chosen],
            self.rate[chosen],
            self.item[chosen],
        )

    def halves(self, middle: Vector, f_middle: Vector) -> Intervals:
        """Returns both halves of each."""
        return Intervals(
            np.concatenate([self.left, middle]),
            np.concatenate([middle, self.right]),
            np.concatenate([self.f_left, f_middle]),
            np.concatenate([f_middle, self.f_right]),
            np.tile(self.rate, 2),
            np.tile(self.item, 2),
        )


def slope_bound(intervals: Intervals) -> Vector:
    """Returns the least f can be on each interval where |f'| is at most `rate`."""
    return (intervals.f_left + intervals.f_right - intervals.rate * (intervals.right - intervals.left)) / 2.0


def curvature_bound(intervals: Intervals) -> Vector:
    """Returns the least f can be on each interval where |f''| is at most `rate`."""
    h = intervals.right - intervals.left
    return np.minimum(intervals.f_left, intervals.f_right) - intervals.rate * h**2 / 8.0


def prove_above(
    evaluate: Callable[[Vector, NDArray[np.intp]], Vector],
    knots: Vector,
    values: Vector,
    rates: Vector,
    required: float,
    least: Callable[[Intervals], Vector],
) -> Proof:
    """Proves f(t) >= `required` over [knots[0], knots[-1]] for every item by bisection, or finds where it fails.

    Args:
        evaluate: f at times (k,) [s] of items (k,).
        knots: increasing times (m,) [s].
        values: f at the knots (m, items).
        rates: of every item on every interval (m-1, items), as `least` takes them.
        required: the bound.
        least: `slope_bound` or `curvature_bound`.
    """
    worst = int(np.argmin(_or_lowest(values)))
    knot, item = np.unravel_index(worst, values.shape)
    best = Proof(float(values[knot, item]), float(knots[knot]), int(item), False)
    shape = (len(knots) - 1, values.shape[1])
    todo = Intervals(
        np.broadcast_to(knots[:-1, None], shape).ravel(),
        np.broadcast_to(knots[1:, None], shape).ravel(),
        values[:-1].ravel(),
        values[1:].ravel(),
        rates.ravel(),
        np.broadcast_to(np.arange(shape[1]), shape).ravel(),
    )
    spent = 0
    for _ in range(ROUNDS):
        todo = todo.keep(~(least(todo) >= required))
        spent += len(todo.left)
        if not best.value >= required or spent > EVALUATIONS_MAX:
            return best
        if len(todo.left) == 0:
            return Proof(best.value, best.at_s, best.item, True)
        middle = (todo.left + todo.right) / 2.0
        f_middle = evaluate(middle, todo.item)
        worst = int(np.argmin(_or_lowest(f_middle)))
        if not f_middle[worst] >= best.value:
            best = Proof(float(f_middle[worst]), float(middle[worst]), int(todo.item[worst]), False)
        todo = todo.halves(middle, f_middle)
    return best


def _or_lowest(f: Vector) -> Vector:
    return np.where(np.isfinite(f), f, -np.inf)
