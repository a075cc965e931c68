"""Brake from anywhere: for every tick of a plan a judged way to rest, computed before anything moves.

Its shape is that of planner.brake_profile: position, speed and acceleration go on continuously. For each
tick the shortest duration is taken whose accelerations the arm bears and whose torques are within the cell's; then
joint range and surroundings are checked along the whole way. Where a brake fails its check the plan is flown on to the
next tick whose brake passes: the plan's own end is always one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.approach.swept_clearance import Space, Ways
from planner.brake_profile import RAMP, parts
from planner.cell import Cell
from planner.dynamics import Payload, joint_torques

Vector = NDArray[np.float64]

STRETCHES = (1.0, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.2, 4.0)  # [-] durations tried, in shares of the shortest
INSTANTS = 25  # looked at along one brake, the corners of its acceleration among them; between them the bounds hold
FADE_S = 0.008  # [s] more, for an acceleration to fade out: a CB3 tick
REST_SPEED = 1e-9  # [rad/s] below it there is nothing to brake


@dataclass(frozen=True, eq=False)
class Brakes:
    """For every row: the first row from which the brake passed its check, and how many ticks that brake takes."""

    row: NDArray[np.int64]
    ticks: NDArray[np.int64]


def brake_way(q: Vector, qd: Vector, qdd: Vector, T: Vector, u: Vector) -> tuple[Vector, Vector, Vector]:
    """Returns q, qd, qdd (M, U, n) along the brakes from states (M, n) of durations T (M,) [s] at shares `u` (U,)."""
    weights = np.array([parts(share) for share in u]).T[:, None, :, None]
    T, q, qd, qdd = T[:, None, None], q[:, None], qd[:, None], qdd[:, None]
    rate = np.where(T > 0.0, 1.0 / np.maximum(T, 1e-9), 0.0)
    way = q + qd * T * weights[0] + qdd * T**2 * weights[1]
    return way, qd * weights[2] + qdd * T * weights[3], qd * rate * weights[4] + qdd * weights[5]


def brakes(cell: Cell, payload: Payload, q: Vector, qd: Vector, qdd: Vector, dt: float, every: int = 1) -> Brakes:
    """Returns the brakes of rows (M, 6) [rad, rad/s, rad/s^2], `dt` [s] apart, the last of them at rest.

    Of `every` so many rows one has a brake of its own; the others wait for it.
    """
    good, ticks = np.zeros(len(q), np.bool_), np.zeros(len(q), np.int64)
    some = slice(None, None, every)
    ticks[some], good[some] = _judged(cell, payload, q[some], qd[some], qdd[some], dt)
    good[-1] = True
    index = np.where(good, np.arange(len(q)), len(q))
    row = np.minimum.accumulate(index[::-1])[::-1]
    return Brakes(row, ticks)


def _judged(
    cell: Cell, payload: Payload, q: Vector, qd: Vector, qdd: Vector, dt: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Returns the duration of every row's brake [ticks], and whether it passes."""
    ticks, bearable = _durations(cell, payload, q, qd, qdd, dt)
    good = bearable & _clear(cell, q, qd, qdd, ticks.astype(np.float64) * dt)
    return ticks, good | ((np.abs(qd).max(axis=1) < REST_SPEED) & (np.abs(qdd).max(axis=1) < REST_SPEED))


def _durations(
    cell: Cell, payload: Payload, q: Vector, qd: Vector, qdd: Vector, dt: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Returns the shortest bearable duration of every row [ticks], and whether there is one."""
    shortest = _shortest(qd, qdd, cell.robot.qdd_max)
    ticks = np.ceil(shortest / dt - 1e-9).astype(np.int64)
    done = ticks == 0
    for stretch in STRETCHES:
        todo = np.flatnonzero(~done)
        if len(todo) == 0:
            break
        tried = np.ceil(shortest[todo] * stretch / dt).astype(np.int64)
        way = brake_way(q[todo], qd[todo], qdd[todo], tried.astype(np.float64) * dt, np.linspace(0.0, 1.0, INSTANTS))
        passed = _bears(cell, payload, *way)
        ticks[todo] = tried
        done[todo[passed]] = True
    return ticks, done


def _shortest(qd: Vector, qdd: Vector, qdd_max: Vector) -> Vector:
    """Returns the duration (M,) [s] at which no acceleration on the way exceeds the arm's: |qd / T + qdd r/2| / (1-r).

    What acts against the speed shortens a brake by no more than it would lengthen one: the size of qdd is taken.
    """
    room = np.maximum(qdd_max * (1.0 - RAMP) - np.abs(qdd) * RAMP / 2.0, 0.25 * qdd_max)
    return (np.abs(qd) / room).max(axis=1) + np.where(np.abs(qdd).max(axis=1) > REST_SPEED, FADE_S, 0.0)


def _bears(cell: Cell, payload: Payload, q: Vector, qd: Vector, qdd: Vector) -> NDArray[np.bool_]:
    """Returns for every brake (M,) whether torques stay within the cell's; the start's are the plan's own."""
    gravity_B = cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
    tau = joint_torques(cell.robot, q, qd, qdd, gravity_B, payload)
    return np.asarray((np.abs(tau[:, 1:]) <= cell.limits.tau_max).all(axis=(1, 2)), np.bool_)


def _clear(cell: Cell, q: Vector, qd: Vector, qdd: Vector, T: Vector) -> NDArray[np.bool_]:
    """Returns for every brake (M,) whether joint range and surroundings are kept, between the instants too."""
    way, speed, acceleration = brake_way(q, qd, qdd, T, np.linspace(0.0, 1.0, INSTANTS))
    step = (T / (INSTANTS - 1))[:, None, None]
    bend = _larger(acceleration) * step**2
    low = np.minimum(way[:, :-1], way[:, 1:]) - bend / 8.0
    high = np.maximum(way[:, :-1], way[:, 1:]) + bend / 8.0
    inside = ((low >= cell.limits.q_lower) & (high <= cell.limits.q_upper)).all(axis=(1, 2))
    clear, _ = Space(cell).judge(Ways(way, _larger(speed) * step + bend, bend))
    return np.asarray(inside & clear, np.bool_)


def _larger(values: Vector) -> Vector:
    """Returns the larger magnitude of each two neighbours along the way."""
    return np.maximum(np.abs(values[:, :-1]), np.abs(values[:, 1:]))
