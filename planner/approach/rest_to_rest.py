"""Motion from rest to rest through postures, straight in between, with bounded jerk, exactly on the tick grid.

Each piece is the double S along its line: the jerk J for a ticks, 0 for b, -J for a, 0 for c, and the same mirrored.
With whole ticks it covers the distance J dt^3 a (a + b) (2a + b + c), so J is chosen to end exactly at the goal.
Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, section 3.4.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from planner.arrays import Array
from planner.cell import Limits
from planner.trajectory import Trajectory, integrate

STILL_RAD = 1e-12  # [rad] shorter moves are none: below what an encoder resolves, above where division overflows
ROUNDING = 1e-9  # [ticks] by which a duration may exceed a whole number


def rest_to_rest_motion(points: Array, limits: Limits, dt: float) -> Trajectory:
    """Returns the motion through postures, at rest in each.

    Args:
        points: the postures (K >= 2, n) [rad].
        limits: bounds on qd, qdd and jerk.
        dt: one tick [s].
    """
    jerks = [jerk for a, b in pairwise(points) if len(jerk := _piece(b - a, limits, dt))]
    jerk = np.concatenate(jerks) if jerks else np.zeros((1, points.shape[1]))
    still = np.zeros(points.shape[1])
    q, qd, qdd = integrate(points[0], still, still, jerk, dt)
    q[-1] = points[-1]
    qd[-1] = 0.0
    qdd[-1] = 0.0
    return Trajectory(1.0 / dt, q, qd, qdd, release_index=len(q) - 1)


def _piece(move: Array, limits: Limits, dt: float) -> Array:
    """Returns the jerks (N, n) of one move (n,) [rad]; N is 0 where it is none."""
    size = np.abs(move)
    moving = size > STILL_RAD
    if not moving.any():
        return np.zeros((0, len(move)))
    bounds = (limits.qd_max, limits.qdd_max, limits.jerk_max)
    v, a, j = (float((bound[moving] / size[moving]).min()) for bound in bounds)
    up, steady, cruise = (math.ceil(t / dt - ROUNDING) for t in _durations(v, a, j))
    up = max(up, 1)
    signs = np.repeat([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0], [up, steady, up, cruise, up, steady, up])
    share = dt**3 * up * (up + steady) * (2 * up + steady + cruise)
    return (signs / share)[:, None] * move


def _durations(v: float, a: float, j: float) -> tuple[float, float, float]:
    """Returns the durations of jerk, steady acceleration and cruise [s] for bounds relative to the length of a move."""
    up = min(a / j, math.sqrt(v / j))
    steady = max(v / a - up, 0.0)
    cruise = 1.0 / v - 2.0 * up - steady
    if cruise >= 0.0:
        return up, steady, cruise
    up = a / j  # too short to reach v: the steady acceleration s solves a (up + s) (2 up + s) = 1
    steady = (-3.0 * up + math.sqrt(up**2 + 4.0 / a)) / 2.0
    if steady >= 0.0:
        return up, steady, 0.0
    return (1.0 / (2.0 * j)) ** (1.0 / 3.0), 0.0, 0.0
