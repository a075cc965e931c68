"""Textbook velocity profiles of joints that arrive together: trapezoid, cubic position, constant acceleration.

Each is a closed form in the time t from 0 to its duration: from rest over a distance d (n,) to a velocity v (n,). A
joint whose distance is opposite to its velocity swings back first. The acceleration steps; `planner.timing.smoothing`
bounds the jerk.
Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sections 2.1.3
(cubic), 2.1.2 (constant acceleration) and 3.2 (trapezoidal velocity).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds import Candidate, least_time

Samples = tuple[Array, Array, Array]

DURATION_MAX_S = 20.0  # [s] longest motion offered; throws take about one second
TICK_TOLERANCE = 1e-9  # [ticks] rounding error of a duration that is a whole number of ticks


@dataclass(frozen=True, eq=False)
class CubicProfile:
    """Cubic position q = c2 t^2 + c3 t^3 from rest over `d` (n,) [rad] to `v` (n,) [rad/s] in `duration_s` [s]."""

    d: Array
    v: Array
    duration_s: float

    def at(self, t: Array) -> Samples:
        """Returns distance, velocity and acceleration (k, n) at times `t` (k,) in [0, duration] [s]."""
        t = np.asarray(t, float)[:, None]
        c2, c3 = cubic_coefficients(self.d, self.v, self.duration_s)
        return t**2 * (c2 + c3 * t), t * (2.0 * c2 + 3.0 * c3 * t), 2.0 * c2 + 6.0 * c3 * t


def cubic_coefficients(d: Array, v: Array, duration: Array | float) -> tuple[Array, Array]:
    """Returns c2 [rad/s^2] and c3 [rad/s^3] of `CubicProfile`."""
    return 3.0 * d / duration**2 - v / duration, v / duration**2 - 2.0 * d / duration**3


def shortest_cubic(d: Array, v: Array, limits: Limits, dt: float) -> CubicProfile:
    """Returns the shortest cubic, in whole ticks, that keeps the limits on velocity and acceleration.

    A longer duration than a feasible one may be infeasible, so every number of ticks is tried.

    Args:
        d: distances (n,) [rad].
        v: final velocities (n,) [rad/s].
        limits: on velocity and acceleration.
        dt: one tick [s].

    Raises:
        SolverFailed: no duration up to `DURATION_MAX_S` keeps the limits.
    """
    for horizon in (0.1 * DURATION_MAX_S, DURATION_MAX_S):
        duration = dt * np.arange(1.0, round(horizon / dt) + 1.0, dtype=np.float64)[:, None]
        good = _cubics_within(d, v, duration, limits)
        if good.any():
            return CubicProfile(d, v, float(duration[int(good.argmax()), 0]))
    raise SolverFailed("no cubic keeps the limits on velocity and acceleration")


def _cubics_within(d: Array, v: Array, duration: Array, limits: Limits) -> Mask:
    """Returns for each duration (k, 1) [s] whether its cubic keeps the limits on velocity and acceleration (k,)."""
    c2, c3 = cubic_coefficients(d, v, duration)
    start = 2.0 * c2
    end = 2.0 * c2 + 6.0 * c3 * duration
    turns = start * end < 0.0  # the velocity then has its extremum -c2^2/(3 c3) inside
    extremum = np.divide(c2**2, 3.0 * c3, out=np.zeros_like(c2), where=turns)
    fast = np.maximum(np.abs(extremum), np.abs(v)) > limits.qd_max
    steep = np.maximum(np.abs(start), np.abs(end)) > limits.qdd_max
    return ~np.any(fast | steep, axis=1)


@dataclass(frozen=True, eq=False)
class TrapezoidProfile:
    """Trapezoidal velocity: a ramp to the cruise velocity, the cruise, a ramp to the final velocity.

    Attributes:
        cruise: cruise velocities (n,) [rad/s], of either sign.
        first, last: accelerations of the two ramps (n,) [rad/s^2].
        up_s, down_s: durations of the two ramps (n,) [s].
        duration_s: total duration, the same for all joints [s].
    """

    cruise: Array
    first: Array
    last: Array
    up_s: Array
    down_s: Array
    duration_s: float

    def at(self, t: Array) -> Samples:
        """Returns distance, velocity and acceleration (k, n) at times `t` (k,) in [0, duration] [s]."""
        t = np.asarray(t, float)[:, None]
        begin = self.duration_s - self.down_s
        up = np.clip(t, 0.0, self.up_s)
        down = np.clip(t - begin, 0.0, None)
        qd = self.first * up + self.last * down
        q = self.first * up**2 / 2.0 + self.cruise * np.clip(t - self.up_s, 0.0, None) + self.last * down**2 / 2.0
        return q, qd, np.where(t < self.up_s, self.first, np.where(t >= begin, self.last, 0.0))


def shortest_trapezoid(d: Array, v: Array, limits: Limits, dt: float) -> TrapezoidProfile:
    """Returns the shortest trapezoid, in whole ticks, that keeps the limits on velocity and acceleration.

    The slowest joint sets the duration; the others accelerate as hard and cruise more slowly.

    Args:
        d: distances (n,) [rad].
        v: final velocities (n,) [rad/s].
        limits: on velocity and acceleration.
        dt: one tick [s].

    Raises:
        SolverFailed: it takes longer than `DURATION_MAX_S`.
    """
    return trapezoid(d, v, whole_ticks(float(least_time(d, v, limits)), dt) * dt, limits.qdd_max)


def trapezoid(d: Array, v: Array, duration: float, a: Array) -> TrapezoidProfile:
    """Returns the trapezoid that takes exactly `duration`.

    With the final velocity counted positive, the distance grows with the cruise velocity c: distances up to v^2/(2a)
    need c <= 0, up to v^2/(2a) + v (T - v/a) they need 0 <= c <= v, and beyond that c >= v.

    Args:
        d: distances (n,) [rad].
        v: final velocities (n,) [rad/s].
        duration: [s], at least every joint's least time.
        a: accelerations of the ramps (n,) [rad/s^2].
    """
    sign = np.where(v < 0.0, -1.0, 1.0)
    d = sign * d
    v = sign * v
    ramp = v**2 / (2.0 * a)
    shorter = duration - v / a
    longer = duration + v / a
    against = -a / 2.0 * (shorter - _root(shorter**2 - 4.0 * (ramp - d) / a))
    beyond = a / 2.0 * (longer - _root(longer**2 - 4.0 * (ramp + d) / a))
    between = (d - ramp) / np.maximum(shorter, 1e-12)
    cruise = np.where(d <= ramp, against, np.where(d <= ramp + v * shorter, between, beyond))
    first = np.sign(cruise) * a
    last = np.sign(v - cruise) * a
    up = np.abs(cruise) / a
    down = np.abs(v - cruise) / a
    return TrapezoidProfile(sign * cruise, sign * first, sign * last, up, down, duration)


def shortest_triangle(d: Array, limits: Limits, dt: float) -> TrapezoidProfile:
    """Returns the motion over `d` (n,) [rad] that accelerates evenly over one half and decelerates over the other."""
    needed = np.maximum(2.0 * np.sqrt(np.abs(d) / limits.qdd_max), 2.0 * np.abs(d) / limits.qd_max)
    duration = whole_ticks(float(needed.max()), dt) * dt
    half = np.full_like(d, duration / 2.0)
    peak = 2.0 * d / duration
    return TrapezoidProfile(peak, peak / half, -peak / half, half, half, duration)


def shortest_ramp(v: Array, limits: Limits, dt: float) -> TrapezoidProfile:
    """Returns constant acceleration from rest to `v` (n,) [rad/s]: over the distance v T/2, straight along `v`."""
    duration = whole_ticks(float((np.abs(v) / limits.qdd_max).max()), dt) * dt
    nothing = np.zeros_like(v)
    return TrapezoidProfile(v, v / duration, nothing, np.full_like(v, duration), nothing, duration)


def linear_brake(v: Array, limits: Limits, dt: float) -> Array:
    """Returns velocities at the ticks (M+1, n) [rad/s] of the fastest stop straight along `v`: v (1 - t/T)."""
    return _brake(v, limits, dt, 1.0)


def cubic_brake(v: Array, limits: Limits, dt: float) -> Array:
    """Returns velocities at the ticks (M+1, n) [rad/s] of a stop along `v` from zero deceleration: v (1 - (t/T)^2)."""
    return _brake(v, limits, dt, 2.0)


def _brake(v: Array, limits: Limits, dt: float, power: float) -> Array:
    """Returns v (1 - (t/T)^power) at the ticks, whose slope is at most `power` times v / T."""
    count = whole_ticks(power * float((np.abs(v) / limits.qdd_max).max()), dt)
    return (1.0 - (np.arange(count + 1) / count) ** power)[:, None] * v


def whole_ticks(duration: float, dt: float) -> int:
    """Returns the number of ticks that cover `duration` [s], at least one.

    Raises:
        SolverFailed: the duration exceeds `DURATION_MAX_S`.
    """
    if duration > DURATION_MAX_S:
        raise SolverFailed(f"the motion would take {duration:.1f} s, and may {DURATION_MAX_S:g} s")
    return max(1, math.ceil(duration / dt - TICK_TOLERANCE))


def _root(x: Array) -> Array:
    return np.sqrt(np.maximum(x, 0.0))


class CubicGuess:
    """A cubic to the release in twice the least time, then even braking.

    Attributes:
        release_time_s: release time [s].
        brake_s: duration of the brake [s].
        duration_s: time of standstill [s].
    """

    def __init__(self, problem: ThrowProblem, candidate: Candidate) -> None:
        self.start = problem.start
        self.qd = candidate.qd
        self.release_time_s = max(2.0 * candidate.bound_s, 0.2)
        self.brake_s = max(1.5 * float(np.max(np.abs(candidate.qd) / problem.limits.qdd_max)), 0.1)
        self.duration_s = self.release_time_s + (0.0 if problem.ends_at_rest else self.brake_s)
        self.launch = CubicProfile(candidate.q - problem.start, candidate.qd, self.release_time_s)

    def at(self, t: Array, /) -> tuple[Array, Array, Array]:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        release = self.release_time_s
        slowing = self.brake_s
        v = self.qd
        d, qd, qdd = self.launch.at(np.minimum(t, release))
        after = np.clip(t - release, 0.0, slowing)[:, None]
        q = self.start + d + v * (after - after**2 / (2 * slowing))
        return q, qd - v * after / slowing, np.where(t[:, None] < release, qdd, -v / slowing)
