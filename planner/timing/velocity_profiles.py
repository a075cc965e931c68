"""Textbook motions of joints that arrive together: trapezoidal velocity, cubic position, constant acceleration.

Each is a closed form of the time t from 0 to its duration, from rest over a distance d (n,) to a velocity v (n,); the
distance may lie against the velocity, the joint then swings back first. Their acceleration steps: jerk is not their
business (see `planner.timing.smoothing`).
Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sections 2.1.3
(cubic), 2.1.2 (constant acceleration) and 3.2 (trapezoidal velocity).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.cell import Limits
from planner.errors import SolverFailed
from planner.seeds.lower_bound import least_time

Vector = NDArray[np.float64]
Samples = tuple[Vector, Vector, Vector]

DURATION_MAX_S = 20.0  # a motion longer than this is no throw
ROUND_UP = 1.0 - 1e-9  # [ticks] a duration that is a whole number of ticks but for rounding stays one


@dataclass(frozen=True, eq=False)
class Cubic:
    """q = c2 t^2 + c3 t^3: the one cubic from rest over `d` [rad] to `v` [rad/s] in `duration_s`."""

    d: Vector
    v: Vector
    duration_s: float

    def at(self, t: Vector) -> Samples:
        """Returns distance, velocity and acceleration (k, n) at times `t` (k,) in [0, duration] [s]."""
        t = np.asarray(t, float)[:, None]
        c2, c3 = cubic_coefficients(self.d, self.v, self.duration_s)
        return t**2 * (c2 + c3 * t), t * (2.0 * c2 + 3.0 * c3 * t), 2.0 * c2 + 6.0 * c3 * t


def cubic_coefficients(d: Vector, v: Vector, duration: Vector | float) -> tuple[Vector, Vector]:
    """Returns c2 [rad/s^2] and c3 [rad/s^3] of `Cubic`."""
    return 3.0 * d / duration**2 - v / duration, v / duration**2 - 2.0 * d / duration**3


def shortest_cubic(d: Vector, v: Vector, limits: Limits, dt: float) -> Cubic:
    """Returns the cubic of the fewest ticks that keeps the limits on velocity and acceleration.

    Whether a duration will do does not grow with it, so every one is looked at.

    Raises:
        SolverFailed: none does, up to `DURATION_MAX_S`.
    """
    for horizon in (0.1 * DURATION_MAX_S, DURATION_MAX_S):
        duration = dt * np.arange(1.0, round(horizon / dt) + 1.0, dtype=np.float64)[:, None]
        good = _cubics_within(d, v, duration, limits)
        if good.any():
            return Cubic(d, v, float(duration[int(good.argmax()), 0]))
    raise SolverFailed("no cubic keeps the limits on velocity and acceleration")


def _cubics_within(d: Vector, v: Vector, duration: Vector, limits: Limits) -> NDArray[np.bool_]:
    """Returns which of the durations (k, 1) give cubics within the limits on velocity and acceleration (k,)."""
    c2, c3 = cubic_coefficients(d, v, duration)
    start, end = 2.0 * c2, 2.0 * c2 + 6.0 * c3 * duration
    turns = start * end < 0.0  # the velocity then has its extremum -c2^2/(3 c3) inside
    extremum = np.divide(c2**2, 3.0 * c3, out=np.zeros_like(c2), where=turns)
    fast = np.maximum(np.abs(extremum), np.abs(v)) > limits.qd_max
    steep = np.maximum(np.abs(start), np.abs(end)) > limits.qdd_max
    return ~np.any(fast | steep, axis=1)


@dataclass(frozen=True, eq=False)
class Trapezoid:
    """A ramp to the cruise velocity, the cruise, and a ramp to the final velocity, all joints in `duration_s`.

    Attributes:
        cruise: velocities between the ramps (n,) [rad/s], of either sign.
        first, last: accelerations of the ramps (n,) [rad/s^2].
        up_s, down_s: durations of the ramps (n,) [s].
    """

    cruise: Vector
    first: Vector
    last: Vector
    up_s: Vector
    down_s: Vector
    duration_s: float

    def at(self, t: Vector) -> Samples:
        """Returns distance, velocity and acceleration (k, n) at times `t` (k,) in [0, duration] [s]."""
        t = np.asarray(t, float)[:, None]
        begin = self.duration_s - self.down_s
        up, down = np.clip(t, 0.0, self.up_s), np.clip(t - begin, 0.0, None)
        qd = self.first * up + self.last * down
        q = self.first * up**2 / 2.0 + self.cruise * np.clip(t - self.up_s, 0.0, None) + self.last * down**2 / 2.0
        return q, qd, np.where(t < self.up_s, self.first, np.where(t >= begin, self.last, 0.0))


def shortest_trapezoid(d: Vector, v: Vector, limits: Limits, dt: float) -> Trapezoid:
    """Returns the trapezoid of the fewest ticks that keeps the limits on velocity and acceleration.

    The slowest joint sets the time; the others take their full acceleration too, and cruise the slower.
    """
    return trapezoid(d, v, whole_ticks(float(least_time(d, v, limits)), dt) * dt, limits.qdd_max)


def trapezoid(d: Vector, v: Vector, duration: float, a: Vector) -> Trapezoid:
    """Returns the trapezoid over `d` [rad] to `v` [rad/s] in exactly `duration` [s] with ramps of `a` [rad/s^2].

    With the final velocity counted positive, the distance grows with the cruise velocity c: up to v^2/(2a) it is
    reached by c <= 0, up to v^2/(2a) + v (T - v/a) by 0 <= c <= v, and beyond by c >= v.
    `duration` is at least the least time of every joint.
    """
    sign = np.where(v < 0.0, -1.0, 1.0)
    d, v = sign * d, sign * v
    ramp = v**2 / (2.0 * a)
    shorter, longer = duration - v / a, duration + v / a
    against = -a / 2.0 * (shorter - _root(shorter**2 - 4.0 * (ramp - d) / a))
    beyond = a / 2.0 * (longer - _root(longer**2 - 4.0 * (ramp + d) / a))
    between = (d - ramp) / np.maximum(shorter, 1e-12)
    cruise = np.where(d <= ramp, against, np.where(d <= ramp + v * shorter, between, beyond))
    first, last = np.sign(cruise) * a, np.sign(v - cruise) * a
    up, down = np.abs(cruise) / a, np.abs(v - cruise) / a
    return Trapezoid(sign * cruise, sign * first, sign * last, up, down, duration)


def shortest_triangle(d: Vector, limits: Limits, dt: float) -> Trapezoid:
    """Returns constant acceleration over the first half of `d` [rad], constant deceleration over the second."""
    needed = np.maximum(2.0 * np.sqrt(np.abs(d) / limits.qdd_max), 2.0 * np.abs(d) / limits.qd_max)
    duration = whole_ticks(float(needed.max()), dt) * dt
    half, peak = np.full_like(d, duration / 2.0), 2.0 * d / duration
    return Trapezoid(peak, peak / half, -peak / half, half, half, duration)


def shortest_ramp(v: Vector, limits: Limits, dt: float) -> Trapezoid:
    """Returns constant acceleration from rest to `v` [rad/s]; its distance is v T/2, straight along the velocity."""
    duration = whole_ticks(float((np.abs(v) / limits.qdd_max).max()), dt) * dt
    nothing = np.zeros_like(v)
    return Trapezoid(v, v / duration, nothing, np.full_like(v, duration), nothing, duration)


def linear_brake(v: Vector, limits: Limits, dt: float) -> Vector:
    """Returns velocities (M+1, n) at the ticks of the fastest stop straight along `v`: v (1 - t/T)."""
    return _brake(v, limits, dt, 1.0, lambda share: 1.0 - share)


def cubic_brake(v: Vector, limits: Limits, dt: float) -> Vector:
    """Returns velocities (M+1, n) at the ticks of the cubic stop along `v` that begins unbraked: v (1 - (t/T)^2)."""
    return _brake(v, limits, dt, 2.0, lambda share: 1.0 - share**2)


def _brake(v: Vector, limits: Limits, dt: float, steepest: float, law: Callable[[Vector], Vector]) -> Vector:
    """Returns v times a law that falls from 1 to 0 over [0, 1], at most `steepest`."""
    count = whole_ticks(steepest * float((np.abs(v) / limits.qdd_max).max()), dt)
    return law(np.arange(count + 1) / count)[:, None] * v


def whole_ticks(duration: float, dt: float) -> int:
    """Returns how many ticks cover `duration` [s], at least one.

    Raises:
        SolverFailed: more than `DURATION_MAX_S`.
    """
    if duration > DURATION_MAX_S:
        raise SolverFailed(f"the motion would take {duration:.1f} s")
    return max(1, math.ceil(duration / dt - (1.0 - ROUND_UP)))


def _root(x: Vector) -> Vector:
    return np.sqrt(np.maximum(x, 0.0))
