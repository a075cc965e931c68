"""Release velocities whose drag-free flights hit a target within the bounds that a request sets: speed and elevation.

A flight from a place to a target is told by its time. The longer it takes, the steeper it leaves; its speed is least at
the time of the slowest throw and rises to both sides.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array, Mask
from planner.errors import Violation
from planner.flight import elevation, launch_velocity, slowest_time, time_at_elevation
from planner.problem import ThrowProblem
from planner.releases import Target
from planner.seeds.flight_filter import clear_flights, flight_times

TIMES_FROM_A_PLACE = np.geomspace(0.4, 3.0, 200)
TIMES_TRIED = 8  # [-], see `_times_from`; 3.0: 84 degrees on a plane
ROUNDING_RAD = 1e-6  # [rad] that an elevation may lie beyond its bounds: a hundredth of what the certificate allows
ELEVATION_ROUNDS = 8  # [-] corrections of a flight's time for drag at most; four are enough for a table tennis ball
FARTHEST_RAD = 0.2  # [rad] that a secant moves an elevation at most
VERTICAL_M = 1e-6  # [m] a target no farther aside than that is reached straight up or down alone


def launches(problem: ThrowProblem, target: Target, p: Array) -> tuple[Array, Mask]:
    """Returns release velocities (k, n, 3) from p (n, 3), and which of them (k, n) keep the limits on the velocity."""
    if target.release_position is not None:
        return _launches_in(problem, target, p, _times_from(problem, target, target.release_position))
    return _launches_in(problem, target, p, np.array(flight_times(problem)))


def _launches_in(problem: ThrowProblem, target: Target, p: Array, times: Array) -> tuple[Array, Mask]:
    """Returns what `launches` does for flight times (k,), relative to that of the slowest throw [-]."""
    t = np.outer(times, slowest_time(p, target.p_W, problem.gravity_at_tool_speed))
    t = _within_elevations(problem, target, p, t)
    v = launch_velocity(p, target.p_W, t, problem.gravity_at_tool_speed)
    return v, allowed_velocity(problem, target, v) & (v[..., 2] < problem.gravity_at_tool_speed * t)


def _within_elevations(problem: ThrowProblem, target: Target, p: Array, t: Array) -> Array:
    """Returns flight times (..., n) from p (n, 3) [s], those beyond the requested elevations at their ends instead.

    NaN where no flight keeps them and falls on the target.
    """
    gravity = problem.gravity_at_tool_speed
    low = target.min_elevation_rad
    high = target.max_elevation_rad
    if low > -math.pi / 2:
        t = np.fmax(t, time_at_elevation(p, target.p_W, low, gravity))
    if high < math.pi / 2:
        last = time_at_elevation(p, target.p_W, high, gravity)
        t = np.where(high > _lowest_elevation(target, p), np.fmin(t, last), np.nan)  # no last one straight down
    return t


def _lowest_elevation(target: Target, p: Array) -> Array:
    """Returns the elevation (...,) [rad] that a drag-free flight from p (..., 3) exceeds if it falls on the target.

    Straight down there is none, unless the request sets a lower bound above -pi/2.
    """
    d = target.p_W - p
    spread = np.hypot(d[..., 0], d[..., 1])
    rise = np.where(d[..., 2] > 0.0, 2.0, 1.0) * d[..., 2]  # twice as steep as the straight line, where that rises
    falls = (d[..., 2] < 0.0) & (target.min_elevation_rad <= -math.pi / 2)
    vertical = np.where(falls, -np.inf, math.pi / 2)
    return np.where(spread > VERTICAL_M, np.arctan2(rise, spread), vertical)


@np.errstate(over="ignore", invalid="ignore")  # of flights that drag brings down before the target: they end as NaN
def with_drag(problem: ThrowProblem, target: Target, p: Array, t: Array) -> Array:
    """Returns the release velocities (n, 3) of flights with drag from p (n, 3) to a target; NaN where there is none.

    They take the times t (n,) [s], but for those whose elevation would be beyond the requested ones: that is theirs.
    Their time is that of a drag-free flight at another elevation, which is found by secants.
    """
    gravity = problem.gravity_at_tool_speed
    low = target.min_elevation_rad
    high = target.max_elevation_rad
    v = launch_velocity(p, target.p_W, t, gravity, problem.drag)
    flown = elevation(v)
    without = elevation(launch_velocity(p, target.p_W, t, gravity))
    wanted = np.clip(flown, low, high)
    off = flown - wanted
    change = -off
    for _ in range(ELEVATION_ROUNDS):
        rows = np.flatnonzero(np.abs(off) > ROUNDING_RAD / 2.0)
        if len(rows) == 0:
            break
        without[rows] += change[rows]
        t = time_at_elevation(p[rows], target.p_W, without[rows], gravity)
        v[rows] = np.nan
        timed = rows[np.isfinite(t)]
        before = off.copy()
        if len(timed) > 0:
            v[timed] = launch_velocity(p[timed], target.p_W, t[np.isfinite(t)], gravity, problem.drag)
        off[rows] = elevation(v[rows]) - wanted[rows]
        turned = np.where(off[rows] != before[rows], off[rows] - before[rows], -change[rows])
        change[rows] = np.clip(change[rows] * -off[rows] / turned, -FARTHEST_RAD, FARTHEST_RAD)
    return v


def _times_from(problem: ThrowProblem, target: Target, p: Array) -> Array:
    """Returns flight times (k,) from a given place (3,), relative to that of the slowest throw [-].

    They are spread over those that are allowed and clear, which may be few; if none is, over all.
    """
    found, allowed = _launches_in(problem, target, p[None], TIMES_FROM_A_PLACE)
    v = found[:, 0]
    kept = allowed[:, 0]
    kept[kept] = clear_flights(problem, target, np.tile(p, (len(v), 1))[kept], v[kept])
    times = TIMES_FROM_A_PLACE[kept] if kept.any() else TIMES_FROM_A_PLACE
    return times[np.unique(np.linspace(0, len(times) - 1, TIMES_TRIED).round().astype(int))]


def allowed_velocity(problem: ThrowProblem, target: Target, v: Array) -> Mask:
    """Returns the mask of the release velocities (..., 3) within the requested elevations and the limits on speed."""
    low = target.min_elevation_rad - ROUNDING_RAD
    high = target.max_elevation_rad + ROUNDING_RAD
    angle = elevation(v)
    return (angle >= low) & (angle <= high) & (np.linalg.norm(v, axis=-1) <= _speed_limit(problem, target))


def is_slow_enough(problem: ThrowProblem, target: Target, p: Array) -> Mask:
    """Returns whether the slowest flight from p (n, 3) within the requested elevations keeps the limits on speed."""
    return _least_speed(problem, target, p) <= _speed_limit(problem, target)


def _least_speed(problem: ThrowProblem, target: Target, p: Array) -> Array:
    """Returns the least speed (n,) [m/s] of a flight from p (n, 3) within the requested elevations; NaN: none."""
    gravity = problem.gravity_at_tool_speed
    t = _within_elevations(problem, target, p, slowest_time(p, target.p_W, gravity))
    return np.linalg.norm(launch_velocity(p, target.p_W, t, gravity), axis=-1)


def _speed_limit(problem: ThrowProblem, target: Target) -> float:
    """Returns the highest release speed [m/s] that request and cell allow."""
    return min(target.max_speed_m_s, problem.limits.tcp_speed_max)


def no_flight(problem: ThrowProblem, target: Target, p: Array) -> Violation:
    """Returns why no flight from the positions (n, 3) hits the target: there is none, or it takes too much speed."""
    speeds = _least_speed(problem, target, p)
    if np.isnan(speeds).all():
        lowest = float(_lowest_elevation(target, p).min())
        detail = f"elevation above which a flight comes down on the target, from {len(p)} postures tried"
        return Violation("release_velocity", lowest, target.max_elevation_rad, "rad", detail=detail)
    name = "release_velocity" if target.max_speed_m_s < problem.limits.tcp_speed_max else "tcp_speed"
    detail = f"least speed that hits the target within the requested elevations, from {len(p)} postures tried"
    return Violation(name, float(np.nanmin(speeds)), _speed_limit(problem, target), "m/s", detail=detail)


def far_enough(target: Target, p: Array) -> Mask:
    """Returns the mask of the positions (n, 3) at least the requested horizontal distance from the target."""
    return np.asarray(np.linalg.norm((p - target.p_W)[:, :2], axis=1) >= target.min_horizontal_distance_m)
