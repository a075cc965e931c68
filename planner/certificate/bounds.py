"""How far a motion can stray between two instants: bounds on speed, acceleration, jerk and snap of its points.

A point beyond joint m at distance at most r_m from the axes before it obeys (jerk constant inside a tick)

    |p'|    <= sum r |qd|                           |p''|   <= sum r |qdd| + sum r |qd qd|
    |p'''|  <= sum r |j| + 3 sum r |qd qdd| + sum r |qd qd qd|
    |p''''| <= 4 sum r |qd j| + 3 sum r |qdd qdd| + 6 sum r |qd qd qdd| + sum r |qd qd qd qd|

where the lever r of a product is that of the outermost joint in it. Source: repeated differentiation of a chain of
rotations; each derivative of a rotation costs one factor, and a cross product never lengthens a vector by more.
A function f with a continuous slope then obeys f >= min(f0, f1) - sup|f''| h^2/8 between two instants h apart, and a
function that changes no faster than L obeys f >= (f0 + f1 - L h)/2. Torques follow the joints' accelerations, whose
slope jumps with the jerk from tick to tick: each jump counts (`kinked_bound`). `prove_above` bisects until one decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.robots import Robot
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

ROUNDS = 16  # bisections of one interval: 2^16 parts of a coarse interval are below a microsecond
EVALUATIONS_MAX = 40_000  # of one check; a motion this close to a limit for this long is not certified


class Rates:
    """Bounds on |qd|, |qdd|, |jerk| of each joint over each of m stretches of time, (n, m) each.

    Attributes:
        sums: of each over the joints up to and with every one, (3, n, m).
    """

    def __init__(self, qd: Vector, qdd: Vector, jerk: Vector) -> None:
        self.qd, self.qdd, self.jerk = qd, qdd, jerk
        self.sums = np.tri(len(qd)) @ np.stack([qd, qdd, jerk])

    @cached_property
    def totals(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Bounds (n, m) on first to fourth derivative of a direction fixed in the link beyond each joint."""
        s, a, j = self.sums
        s2 = s * s
        return s, a + s2, j + 3 * s * a + s2 * s, 4 * s * j + 3 * a * a + 6 * s2 * a + s2 * s2

    @cached_property
    def by_derivative(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Weights (n, m) of the levers in the bounds on first to fourth derivative of a point."""
        n = len(self.qd)
        one_less_the_one_before = np.eye(n) - np.eye(n, k=-1)
        return tuple(one_less_the_one_before @ total for total in self.totals)  # pyright: ignore[reportReturnType]

    @property
    def turning(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Bounds (m,) on first to fourth derivative of any direction fixed in the last link."""
        one, two, three, four = self.totals
        return one[-1], two[-1], three[-1], four[-1]


def joint_rates(trajectory: Trajectory, knots: Index | None = None) -> Rates:
    """Returns what the joints do at most between neighbouring `knots` (k,), samples; inside every tick by default."""
    if knots is None:
        knots = np.arange(len(trajectory.q))
    first, last = knots[0], knots[-1]
    rows = np.concatenate([trajectory.qd, trajectory.qdd], axis=1)[first : last + 1]
    size, jerk = np.abs(rows.T), np.abs(trajectory.jerk[first:last].T)
    inside = np.maximum.reduceat(size[:, :-1], knots[:-1] - first, axis=1)
    most = np.maximum(inside, size[:, knots[1:] - first])
    jerk_most = np.maximum.reduceat(jerk, knots[:-1] - first, axis=1)
    n = trajectory.q.shape[1]
    return Rates(most[:n] + jerk_most * trajectory.dt**2 / 8.0, most[n:], jerk_most)


def jerk_jumps(trajectory: Trajectory, knots: Index) -> Vector:
    """Returns how much the jerk of each joint changes inside every stretch between `knots`, all in all (n, m)."""
    jumps = np.zeros((trajectory.q.shape[1], knots[-1] + 1))
    jumps[:, 1:-1] = np.abs(np.diff(trajectory.jerk[: knots[-1]], axis=0)).T
    jumps[:, knots] = 0.0  # at the ends of a stretch they bend nothing inside
    return np.add.reduceat(jumps, knots[:-1], axis=1)


def levers(robot: Robot, frame: int, reach: float) -> Vector:
    """Returns for each joint (6,) how far a point within `reach` [m] of DH frame `frame`'s origin is from its axis.

    The offset d of a joint's own link lies along its axis and does not count; joints after `frame` do not move it.
    They fall towards the tool.
    """
    own = np.abs(robot.a)
    beyond = np.hypot(robot.a, robot.d)
    lever = np.zeros(6)
    for j in range(frame):
        lever[j] = own[j] + beyond[j + 1 : frame].sum() + reach
    return np.maximum.accumulate(lever[::-1])[::-1]  # rounding alone could make them grow


def point_speed(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest speed (m,) over every stretch [m/s], or (k, m) of k points with levers (k, 6)."""
    return lever @ rates.by_derivative[0]


def point_acceleration(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest acceleration over every stretch likewise [m/s^2]."""
    return lever @ rates.by_derivative[1]


def point_jerk(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest jerk over every stretch likewise [m/s^3]."""
    return lever @ rates.by_derivative[2]


def point_snap(lever: Vector, rates: Rates) -> Vector:
    """Returns the largest fourth derivative over every stretch likewise [m/s^4]."""
    return lever @ rates.by_derivative[3]


@dataclass(frozen=True)
class Proof:
    """The smallest value met, when [s], on which item, and whether the bound is proven for every instant."""

    value: float
    at_s: float
    item: int
    proven: bool


@dataclass(frozen=True, eq=False)
class Intervals:
    """Stretches of time on which a bound is undecided: ends [s], values there, rate bound (..., k), item; each (k,)."""

    left: Vector
    right: Vector
    f_left: Vector
    f_right: Vector
    rate: Vector
    item: Index

    def keep(self, chosen: NDArray[np.bool_]) -> Intervals:
        """Returns the chosen ones."""
        return Intervals(
            self.left[chosen],
            self.right[chosen],
            self.f_left[chosen],
            self.f_right[chosen],
            self.rate[..., chosen],
            self.item[chosen],
        )

    def halves(self, middle: Vector, f_middle: Vector) -> Intervals:
        """Returns both halves of each."""
        return Intervals(
            np.concatenate([self.left, middle]),
            np.concatenate([middle, self.right]),
            np.concatenate([self.f_left, f_middle]),
            np.concatenate([f_middle, self.f_right]),
            np.concatenate([self.rate, self.rate], axis=-1),
            np.tile(self.item, 2),
        )


Least = Callable[[Vector, Vector, Vector, Vector], Vector]  # of values at both ends, rate and length of intervals


def slope_bound(f_left: Vector, f_right: Vector, rate: Vector, h: Vector) -> Vector:
    """Returns the least f can be on each interval of length h where |f'| is at most `rate`."""
    return (f_left + f_right - rate * h) / 2.0


def curvature_bound(f_left: Vector, f_right: Vector, rate: Vector, h: Vector) -> Vector:
    """Returns the least f can be on each interval of length h where |f''| is at most `rate`."""
    return np.minimum(f_left, f_right) - rate * (h * h / 8.0)


def kinked_bound(f_left: Vector, f_right: Vector, rates: Vector, h: Vector) -> Vector:
    """Returns the least f can be where |f''| is at most rates[0] but for kinks whose jumps of f' add up to rates[1].

    A jump d at a time s after the left end moves f from its chord by d s (h - s) / h, at most d h/4.
    """
    return np.minimum(f_left, f_right) - (rates[0] * (h / 8.0) + rates[1] / 4.0) * h


def prove_above(
    evaluate: Callable[[Vector, Index], Vector],
    knots: Vector,
    values: Vector,
    rates: Vector,
    required: float,
    least: Least,
) -> Proof:
    """Proves f(t) >= `required` over [knots[0], knots[-1]] for every item by bisection, or finds where it fails.

    Args:
        evaluate: f at times (k,) [s] of items (k,).
        knots: increasing times (m,) [s].
        values: f at the knots (items, m), or less than it where that is enough.
        rates: of every item on every interval (..., items, m-1) or (m-1,), as `least` takes them.
        required: the bound.
        least: `slope_bound`, `curvature_bound` or `kinked_bound`.
    """
    item, knot = divmod(int(values.argmin()), values.shape[1])  # the first that is not a number, if there is one
    best = Proof(float(values[item, knot]), float(knots[knot]), item, False)
    if not best.value >= required:
        return best
    enough = least(values[:, :-1], values[:, 1:], rates, np.diff(knots)) >= required
    if enough.all():
        return replace(best, proven=True)
    items, parts = np.nonzero(~enough)
    rate = np.broadcast_to(rates, (*rates.shape[:-2], *enough.shape))[..., items, parts]
    todo = Intervals(knots[parts], knots[parts + 1], values[items, parts], values[items, parts + 1], rate, items)
    return _bisect(evaluate, todo, best, required, least)


def _bisect(
    evaluate: Callable[[Vector, Index], Vector], todo: Intervals, best: Proof, required: float, least: Least
) -> Proof:
    spent = 0
    for _ in range(ROUNDS):
        spent += len(todo.left)
        if spent > EVALUATIONS_MAX:
            return best
        middle = (todo.left + todo.right) / 2.0
        f_middle = evaluate(middle, todo.item)
        worst = int(f_middle.argmin())
        if not f_middle[worst] >= best.value:
            best = Proof(float(f_middle[worst]), float(middle[worst]), int(todo.item[worst]), False)
        if not best.value >= required:
            return best
        todo = todo.halves(middle, f_middle)
        todo = todo.keep(~(least(todo.f_left, todo.f_right, todo.rate, todo.right - todo.left) >= required))
        if len(todo.left) == 0:
            return replace(best, proven=True)
    return best
