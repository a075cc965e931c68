"""Motion from rest to rest along straight pieces between postures, with bounded jerk, exactly on the tick grid.

Along each piece the arm runs at constant velocity, and it changes from one velocity to another along a double S: the
jerk J for a ticks, 0 for b, -J for a. At both ends of the motion the velocity is nothing. At a corner that of one piece
becomes that of the next, both slowed down to the same share of the limits: while it changes, the motion cuts the
corner. With a share of 0 it stops there. No two changes overlap, so the motion keeps every limit that each of them
keeps; and with whole ticks a piece has one speed at which it ends exactly where the next begins.
Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, section 3.4.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from planner.arrays import Array
from planner.cell import Limits
from planner.trajectory import Trajectory, integrate

# [rad, rad/s] smaller moves and changes are none: below what an encoder resolves, above where division overflows
STILL_RAD = 1e-12
ROUNDING = 1e-9  # [ticks] by which a duration may exceed a whole number
HALVINGS = 50  # [-] of the speed of a piece too short for the limit
LEAST_CHANGE = 0.05  # [-] of the speed at a corner: changes from it take as long as this one at least, to spare ticks
SLOWER = 0.8  # [-] of the speed, at the corners of a piece too short for them
SLOWEST = 0.1  # [-] of the limits: at a slower corner the motion stops


def rest_to_rest_motion(points: Array, limits: Limits, dt: float, corners: Array | None = None) -> Trajectory:
    """Returns the motion along straight pieces between postures, at rest in the first and the last.

    Args:
        points: the postures (K >= 2, n) [rad].
        limits: bounds on qd, qdd and jerk.
        dt: one tick [s].
        corners: share of the limits at which it passes each posture at most (K,); None: it stops in every one.
    """
    moves = np.diff(points, axis=0)
    moving = np.append(np.abs(moves).max(axis=1) > STILL_RAD, False)
    moves = moves[moving[:-1]]
    shares = np.zeros(len(moves) + 1)
    if corners is not None:
        shares[1:-1] = corners[moving][1:]
    jerk = _jerks(moves, shares, limits, dt) if len(moves) else np.zeros((1, points.shape[1]))
    still = np.zeros(points.shape[1])
    q, qd, qdd = integrate(points[0], still, still, jerk, dt)
    q[-1] = points[-1]
    qd[-1] = 0.0
    qdd[-1] = 0.0
    return Trajectory(1.0 / dt, q, qd, qdd, release_index=len(q) - 1)


def _jerks(moves: Array, shares: Array, limits: Limits, dt: float) -> Array:
    """Returns the jerks (N, n) of moves (m, n) [rad] that pass the corners at shares (m + 1,) of the limits, or less.

    Both corners of a piece that is too short for them are slowed down until all pieces are long enough.
    """
    fastest = 1.0 / np.abs(moves / limits.qd_max).max(axis=1)
    while True:
        speeds = np.stack([shares[:-1], shares[1:]], axis=1) * fastest[:, None]
        changes = moves[1:] * speeds[1:, :1] - moves[:-1] * speeds[:-1, 1:]
        turns = [_turn(change, limits, dt) for change in changes]
        cut = [0, *map(len, turns), 0]
        pieces = [
            _piece(*each, limits, dt)
            for each in zip(moves, fastest.tolist(), speeds.tolist(), pairwise(cut), strict=True)
        ]
        short = np.array([piece is None for piece in pieces])
        if not short.any():
            both = zip(pieces, [*turns, moves[:0]], strict=True)
            return np.concatenate([rows for each in both for rows in each if rows is not None])
        shares = np.where(np.append(short, False) | np.append(False, short), SLOWER * shares, shares)
        shares[shares < SLOWEST] = 0.0


def _turn(change: Array, limits: Limits, dt: float) -> Array:
    """Returns the jerks (N, n) of the shortest change of velocity (n,) [rad/s]; N is 0 where it is none."""
    if np.abs(change).max() <= STILL_RAD:
        return np.zeros((0, len(change)))
    return _double_s(change, *_ticks(_ramp(*_relative(change, limits)), dt), dt)


def _piece(
    move: Array, fastest: float, speeds: list[float], cut: tuple[int, int], limits: Limits, dt: float
) -> Array | None:
    """Returns the jerks (N, n) of one move between its corners; None if it is too short.

    Args:
        move: the way from corner to corner (n,) [rad].
        fastest: speed within the limits, in parts of the move like all speeds here [1/s].
        speeds: behind the corner before it, and before the corner behind it [1/s].
        cut: ticks that the changes of velocity at these corners take.
        limits, dt: see `rest_to_rest_motion`.
    """
    acceleration, jerk = _relative(move, limits)

    def ramp(speed: float, corner: float) -> tuple[float, float]:
        change = max(abs(speed - corner), LEAST_CHANGE * corner)
        return _ramp(acceleration / change, jerk / change)

    def covered(speed: float) -> float:
        way = 0.0
        for corner, ticks in zip(speeds, cut, strict=True):
            up, steady = ramp(speed, corner)
            way += 0.5 * (corner * ticks * dt + (corner + speed) * (2.0 * up + steady))
        return way

    speed = fastest
    low = max(speeds)
    if low > 0.0 and covered(low) > 1.0:
        return None
    if covered(speed) > 1.0:
        high = speed
        for _ in range(HALVINGS):
            speed = 0.5 * (low + high)
            low, high = (speed, high) if covered(speed) <= 1.0 else (low, speed)
    cruise = math.ceil((1.0 - covered(speed)) / speed / dt - ROUNDING)
    ticks = [_ticks(ramp(speed, corner), dt) for corner in speeds]
    lasting = [2 * up + steady for up, steady in ticks]
    at_corners = sum(corner * (each + other) for corner, each, other in zip(speeds, cut, lasting, strict=True))
    exact = (1.0 / dt - 0.5 * at_corners) / (0.5 * sum(lasting) + max(cruise, 0))
    if exact < (1.0 - LEAST_CHANGE) * max(speeds):
        return None
    first = _double_s((exact - speeds[0]) * move, *ticks[0], dt)
    last = _double_s((speeds[1] - exact) * move, *ticks[1], dt)
    return np.concatenate([first, np.zeros((max(cruise, 0), len(move))), last])


def _relative(change: Array, limits: Limits) -> tuple[float, float]:
    """Returns the bounds on acceleration and jerk in parts of a change (n,)."""
    size = np.abs(change)
    return 1.0 / float((size / limits.qdd_max).max()), 1.0 / float((size / limits.jerk_max).max())


def _ramp(acceleration: float, jerk: float) -> tuple[float, float]:
    """Returns the durations of either jerk and of the steady acceleration [s] of a change of one."""
    up = min(acceleration / jerk, 1.0 / math.sqrt(jerk))
    return up, max(1.0 / acceleration - up, 0.0)


def _ticks(ramp: tuple[float, float], dt: float) -> tuple[int, int]:
    """Returns the durations of `_ramp` in whole ticks."""
    up, steady = (math.ceil(t / dt - ROUNDING) for t in ramp)
    return max(up, 1), steady


def _double_s(change: Array, up: int, steady: int, dt: float) -> Array:
    """Returns the jerks (2 up + steady, n) of a change of velocity (n,) [rad/s]."""
    signs = np.repeat([1.0, 0.0, -1.0], [up, steady, up])
    return (signs / (dt**2 * up * (up + steady)))[:, None] * change
