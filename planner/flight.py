"""Free flight of the object: landing point, its sensitivities, and release velocities that hit a target.

World frame, z up, gravity along -z. Without drag every result has a closed form. With drag (a sphere in still air,
a = -g z - k |v| v) the path is integrated by the classical fourth-order Runge-Kutta method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.native import loops

AIR_DENSITY_KG_M3 = 1.204  # source: ISO 2533 standard atmosphere, dry air at 20 degC and 101,325 Pa
STEP_S = 0.004  # [s] Runge-Kutta step: landing error below 1e-9 m for |v| <= 10 m/s and k <= 1 /m (see the tests)
FLIGHT_MAX_S = 30.0  # [s] longest flight that is integrated
LAUNCH_TOLERANCE_M = 1e-10  # [m] miss at which Newton's iteration for a release velocity with drag stops
LAUNCH_ITERATIONS = 30  # of Newton's method at most
DIFFERENCE = 1e-6  # [m, m/s] step of the central differences for a flight with drag


@dataclass(frozen=True, eq=False)
class Flight:
    """A free flight from the release to the landing plane.

    Attributes:
        landing_point: (3,) [m].
        landing_velocity: (3,) [m/s].
        time_of_flight_s: from release to landing [s].
        apex_height_m: greatest height [m].
        speed_m_s: release speed [m/s].
    """

    landing_point: Array
    landing_velocity: Array
    time_of_flight_s: float
    apex_height_m: float
    speed_m_s: float


class LandingStates(NamedTuple):
    """States of n flights at their landing.

    Attributes:
        p: positions (n, 3) [m].
        v: velocities (n, 3) [m/s].
        time_s: times of flight (n,) [s].
    """

    p: Array
    v: Array
    time_s: Array


def drag_constant(mass_kg: float, radius_m: float, drag_coefficient: float) -> float:
    """Returns the constant k [1/m] of a sphere's deceleration k |v|^2: rho c_d pi r^2 / (2 m)."""
    return 0.5 * AIR_DENSITY_KG_M3 * drag_coefficient * math.pi * radius_m**2 / mass_kg


def time_of_flight(height: ArrayLike, v_z: ArrayLike, gravity: float) -> Array:
    """Returns the time at which a drag-free flight falls through a plane (...,) [s], NaN where it never does.

    Args:
        height: height of the release above the plane (...,) [m].
        v_z: upward velocity at the release (...,) [m/s].
        gravity: [m/s^2].
    """
    height = np.asarray(height, float)
    v_z = np.asarray(v_z, float)
    square = v_z**2 + 2.0 * gravity * height
    with np.errstate(invalid="ignore"):
        t = (v_z + np.sqrt(square)) / gravity
    return np.where((square >= 0.0) & (t >= 0.0), t, np.nan)


def landing_points(p: ArrayLike, v: ArrayLike, plane_z: float, gravity: float, drag: float = 0.0) -> Array:
    """Returns the landing points (..., 3) [m] of flights on the plane z = `plane_z`, NaN where they miss it.

    Args:
        p: release positions (..., 3) [m]; (n, 3) with drag.
        v: release velocities of the same shape [m/s].
        plane_z: height of the plane [m].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    p = np.asarray(p, float)
    v = np.asarray(v, float)
    if drag > 0.0:
        return landing_states(p, v, plane_z, gravity, drag).p
    return _landed(p, v, time_of_flight(p[..., 2] - plane_z, v[..., 2], gravity), plane_z)


def _landed(p: Array, v: Array, t: Array, plane_z: float) -> Array:
    """Returns the landing points (..., 3) [m] of flights that take `t` (...,) [s]; NaN where that is."""
    landed = p + v * t[..., None]
    landed[..., 2] = np.where(np.isnan(t), np.nan, plane_z)
    return landed


def landing_states(p: ArrayLike, v: ArrayLike, plane_z: float, gravity: float, drag: float = 0.0) -> LandingStates:
    """Returns where, how fast and when n flights meet the plane z = `plane_z`; NaN where they miss it.

    Args:
        p: release positions (n, 3) [m].
        v: release velocities (n, 3) [m/s].
        plane_z: height of the plane [m].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    p = np.asarray(p, float)
    v = np.asarray(v, float)
    if drag > 0.0:
        return _landing_states_with_drag(np.concatenate([p, v], axis=1), plane_z, gravity, drag)
    t = time_of_flight(p[:, 2] - plane_z, v[:, 2], gravity)
    velocity = v - np.array([0.0, 0.0, gravity]) * t[:, None]
    return LandingStates(_landed(p, v, t, plane_z), velocity, t)


def fly(p: ArrayLike, v: ArrayLike, plane_z: float, gravity: float, drag: float = 0.0) -> Flight | None:
    """Returns the flight from a release down to the plane z = `plane_z`, None where it never reaches the plane.

    Args:
        p: release position (3,) [m].
        v: release velocity (3,) [m/s].
        plane_z: height of the plane [m].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    p = np.asarray(p, float)
    v = np.asarray(v, float)
    speed = float(np.linalg.norm(v))
    if drag > 0.0:
        return _fly_with_drag(p, v, plane_z, gravity, drag)
    height = float(p[2])
    upward = float(v[2])
    square = upward**2 + 2.0 * gravity * (height - plane_z)
    t = (upward + math.sqrt(square)) / gravity if square >= 0.0 else math.nan
    if not t >= 0.0:
        return None
    landing = p + v * t
    velocity = v.copy()
    landing[2] = plane_z
    velocity[2] = upward - gravity * t
    return Flight(landing, velocity, t, height + max(upward, 0.0) ** 2 / (2.0 * gravity), speed)


def touchdown_s(
    p: ArrayLike, v: ArrayLike, plane_z: float, radius_m: float, gravity: float, drag: float
) -> float | None:
    """Returns when a sphere touches a plane, or else its centre passes it, after its release [s]; None for never.

    Args:
        p, v, plane_z, gravity, drag: as of `fly`.
        radius_m: of the sphere [m].
    """
    flights = (fly(p, v, height, gravity, drag) for height in (plane_z + radius_m, plane_z))
    return next((flight.time_of_flight_s for flight in flights if flight is not None), None)


def path(p: ArrayLike, v: ArrayLike, times: ArrayLike, gravity: float, drag: float = 0.0) -> Array:
    """Returns the object's positions (n, 3) [m] at increasing `times` (n,) [s] after the release."""
    p = np.asarray(p, float)
    v = np.asarray(v, float)
    times = np.asarray(times, float)
    if drag <= 0.0:
        return p + v * times[:, None] - np.array([0.0, 0.0, 0.5 * gravity]) * times[:, None] ** 2
    return paths(p[None], v[None], times[None], gravity, drag)[0]


def paths(p: Array, v: Array, times: Array, gravity: float, drag: float) -> Array:
    """Returns the positions (m, n, 3) [m] of m flights with drag, each at its own increasing times after its release.

    Args:
        p: release positions (m, 3) [m].
        v: release velocities (m, 3) [m/s].
        times: (m, n) [s].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    durations = np.diff(times, axis=1, prepend=0.0)
    steps = np.ceil(durations.max(axis=0, initial=0.0) / STEP_S).astype(np.intp)
    h = durations / np.maximum(steps, 1)
    return loops.drag_paths(np.concatenate([p, v], axis=1), steps, h, (gravity, drag))


def positions_after(p: ArrayLike, v: ArrayLike, times: ArrayLike, gravity: float, drag: float = 0.0) -> Array:
    """Returns the positions (k, 3) [m] of k flights, each at its own time (k,) [s] after its release.

    Args:
        p: release positions (k, 3) [m].
        v: release velocities (k, 3) [m/s].
        times: [s].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    p = np.asarray(p, float)
    v = np.asarray(v, float)
    times = np.asarray(times, float)[:, None]
    if drag <= 0.0 or times.size == 0:
        return p + v * times - np.array([0.0, 0.0, 0.5 * gravity]) * times**2
    steps = np.array([max(1, math.ceil(float(np.max(times)) / STEP_S))])
    return loops.drag_paths(np.concatenate([p, v], axis=1), steps, times / steps, (gravity, drag))[:, 0]


def landing_sensitivity(
    p: ArrayLike, v: ArrayLike, plane_z: float, gravity: float, drag: float = 0.0
) -> tuple[Array, Array] | None:
    """Returns the derivatives of the landing point by release position (3, 3) and by release velocity (3, 3) [s].

    The landing point is L = p + v t + g t^2/2, where the plane gives t: dt/dp_z = -1/w_z and dt/dv_z = -t/w_z with the
    landing velocity w. So dL/dp = I - w e_z^T / w_z and dL/dv = t dL/dp. With drag: central differences.

    Args:
        p: release position (3,) [m].
        v: release velocity (3,) [m/s].
        plane_z: height of the plane [m].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].

    Returns:
        The two derivatives; None where the flight never reaches the plane or only touches it.
    """
    flight = fly(p, v, plane_z, gravity, drag)
    if flight is None or flight.landing_velocity[2] >= 0.0:
        return None
    if drag > 0.0:
        p = np.asarray(p, float)
        v = np.asarray(v, float)
        both = _derivative(lambda s: landing_points([p + s[:3]], [v + s[3:]], plane_z, gravity, drag)[0], 6)
        return None if np.isnan(both).any() else (both[:, :3], both[:, 3:])
    w = flight.landing_velocity
    by_position = np.eye(3)
    by_position[:, 2] -= w / w[2]
    return by_position, flight.time_of_flight_s * by_position


def landing_per_release_delay(
    p: ArrayLike, v: ArrayLike, a: ArrayLike, plane_z: float, gravity: float, drag: float = 0.0, factor: float = 1.0
) -> Array:
    """Returns the landing point's derivative by the release time (3,) [m/s], NaN where the object never lands.

    Args:
        p: release position (3,) [m].
        v: velocity of the tool centre point at the release (3,) [m/s].
        a: acceleration of the tool centre point at the release (3,) [m/s^2].
        plane_z: height of the plane [m].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
        factor: the object's speed over the tool's [-].
    """
    sensitivity = landing_sensitivity(p, factor * np.asarray(v, float), plane_z, gravity, drag)
    if sensitivity is None:
        return np.full(3, np.nan)
    by_position, by_velocity = sensitivity
    return by_position @ np.asarray(v, float) + by_velocity @ (factor * np.asarray(a, float))


def launch_velocity(p: ArrayLike, target: ArrayLike, time_s: ArrayLike, gravity: float, drag: float = 0.0) -> Array:
    """Returns the release velocities (..., 3) [m/s] that take the object from `p` to `target` in `time_s`.

    With drag, Newton's method starting from the drag-free velocity; NaN where it does not converge.

    Args:
        p: release positions (..., 3) [m].
        target: target positions (..., 3) [m].
        time_s: times of flight (...,) [s].
        gravity: [m/s^2].
        drag: k of `drag_constant` [1/m].
    """
    p, target, t = np.broadcast_arrays(p, target, np.asarray(time_s, float)[..., None])
    v = (target - p) / t + np.array([0.0, 0.0, 0.5 * gravity]) * t
    if drag <= 0.0:
        return v
    shape = v.shape
    (p, target, t, v) = (np.atleast_2d(each) for each in (p, target, t, v))
    rows = np.nonzero(missed := np.full(v.shape[:-1], np.inf))  # those that have neither converged nor diverged

    def reached(change: Array) -> Array:
        return positions_after(p[rows], v[rows] + change, t[rows][..., 0], gravity, drag)

    for _ in range(LAUNCH_ITERATIONS):
        missed[rows] = np.abs(error := target[rows] - reached(np.zeros(3))).max(axis=-1)
        if not (far := missed[rows] >= LAUNCH_TOLERANCE_M).any():
            break
        rows = tuple(each[far] for each in rows)
        v[rows] += np.linalg.solve(_derivative(reached, 3), error[far][..., None])[..., 0]
    return np.where((missed < LAUNCH_TOLERANCE_M)[..., None], v, np.nan).reshape(shape)


def slowest_time(p: ArrayLike, target: ArrayLike, gravity: float) -> Array:
    """Returns the time (...,) [s] of the slowest drag-free throw from `p` (..., 3) to `target`: sqrt(2 |d| / g)."""
    d = np.asarray(target, float) - np.asarray(p, float)
    return np.sqrt(2.0 * np.linalg.norm(d, axis=-1) / gravity)


def least_speed(p: ArrayLike, target: ArrayLike, gravity: float) -> Array:
    """Returns the least speed (...,) [m/s] of a drag-free throw from `p` (..., 3) to `target`: sqrt(g (|d| + d_z))."""
    d = np.asarray(target, float) - np.asarray(p, float)
    return np.sqrt(gravity * np.maximum(np.linalg.norm(d, axis=-1) + d[..., 2], 0.0))


def elevation(v: Array) -> Array:
    """Returns the elevation (...,) [rad] of velocities `v` (..., 3) above the horizontal."""
    return np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))


def time_at_elevation(p: ArrayLike, target: ArrayLike, elevation_rad: ArrayLike, gravity: float) -> Array:
    """Returns the time (...,) [s] of the drag-free throw from `p` (..., 3) at an elevation (...,); NaN without one."""
    d = np.asarray(target, float) - np.asarray(p, float)
    square = 2.0 * (np.hypot(d[..., 0], d[..., 1]) * np.tan(elevation_rad) - d[..., 2]) / gravity
    return np.sqrt(np.where(square > 0.0, square, np.nan))


def _fly_with_drag(p: Array, v: Array, plane_z: float, gravity: float, drag: float) -> Flight | None:
    found = loops.drag_landings(np.concatenate([p, v])[None], plane_z, (STEP_S, FLIGHT_MAX_S), (gravity, drag))[0]
    if math.isnan(found[6]):
        return None
    return Flight(found[:3], found[3:6], float(found[6]), float(found[7]), float(np.linalg.norm(v)))


def _landing_states_with_drag(state: Array, plane_z: float, gravity: float, drag: float) -> LandingStates:
    """Returns the landing of flights from states (n, 6), as `_fly_with_drag` finds it."""
    found = loops.drag_landings(state, plane_z, (STEP_S, FLIGHT_MAX_S), (gravity, drag))
    return LandingStates(found[:, :3], found[:, 3:6], found[:, 6])


def _derivative(function: Callable[[Array], Array], size: int) -> Array:
    """Returns the derivative (..., 3, size) of a function (..., 3) of a change (size,) at none: central differences."""
    steps = DIFFERENCE * np.eye(size)
    return np.stack([(function(step) - function(-step)) / (2.0 * DIFFERENCE) for step in steps], axis=-1)
