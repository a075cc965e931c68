"""Brakes: for every row of a motion a verified motion to rest, computed before anything moves.

The shape is that of `planner.brake_profile`: position, speed and acceleration are continuous. For each row the
shortest duration is chosen whose accelerations and torques the arm is rated for: the cell's share of the torques is
for motions, and a stop is to be short. Joint range and clearance are then verified along the whole brake. Where a
brake fails, the motion continues to the next row whose brake passes; its own end always does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.approach.swept_clearance import SweptPaths, keep_clear
from planner.arrays import Array, Mask
from planner.brake_profile import RAMP, SLOPE, brake_weights
from planner.cell import Cell
from planner.dynamics import gravity_in_base, joint_torques, payload_of
from planner.kinematics import forward, tcp_acceleration

Ticks = NDArray[np.int64]

STRETCH = 1.05  # [-] from one duration tried to the next: a brake is at most so much longer than it must be
STRETCHES = (*(STRETCH**k for k in range(26)), 3.5)  # [-] durations tried, over the shortest
INSTANTS = 25  # [-] evaluated along a brake, the corners of its acceleration among them; bounds hold in between
REFINEMENTS = 5  # [-] numbers of instants tried, each twice the one before: at last 0.3 ms apart in 0.1 s
FADE_S = 0.008  # [s] added for an acceleration to fade out: a CB3 tick
REST_SPEED = 1e-9  # [rad/s, rad/s^2] below which the arm is at rest


@dataclass(frozen=True, eq=False)
class Brakes:
    """Brakes of M rows.

    Attributes:
        row: for each row, the first one from it on whose brake is verified (M,).
        ticks: duration of each row's own brake (M,) [ticks].
    """

    row: Ticks
    ticks: Ticks


def brake_path(q: Array, qd: Array, qdd: Array, T: Array, u: Array) -> tuple[Array, Array, Array]:
    """Returns q, qd, qdd (M, U, n) along brakes.

    Args:
        q, qd, qdd: states in which the brakes begin (M, n) [rad, rad/s, rad/s^2].
        T: their durations (M,) [s].
        u: shares of the duration (U,) [-].
    """
    weights = np.array([brake_weights(share) for share in u]).T[:, None, :, None]
    T = T[:, None, None]
    q = q[:, None]
    qd = qd[:, None]
    qdd = qdd[:, None]
    rate = np.where(T > 0.0, 1.0 / np.maximum(T, 1e-9), 0.0)
    position = q + qd * T * weights[0] + qdd * T**2 * weights[1]
    return position, qd * weights[2] + qdd * T * weights[3], qd * rate * weights[4] + qdd * weights[5]


def find_brakes(
    cell: Cell, q: Array, qd: Array, qdd: Array, dt: float, with_object: bool = True, gentle: bool = False
) -> Brakes:
    """Returns the brakes of the rows of a motion.

    Args:
        cell: the robot station.
        q, qd, qdd: rows (M, 6) [rad, rad/s, rad/s^2]; the last is at rest.
        dt: time between them [s].
        with_object: whether the object is in the tool.
        gentle: brake no harder than the grip withstands, where a longer brake is soft enough. A launch is braked as
            hard as its torques allow: from there the longest brake would run for half a second.
    """
    durations = _BrakeDurations(cell, with_object, gentle and with_object)
    ticks, feasible = durations.shortest(q, qd, qdd, dt)
    verified = feasible & _keeps_clear(cell, q, qd, qdd, ticks.astype(np.float64) * dt, with_object)
    verified |= (np.abs(qd).max(axis=1) < REST_SPEED) & (np.abs(qdd).max(axis=1) < REST_SPEED)
    verified[-1] = True
    index = np.where(verified, np.arange(len(q)), len(q))
    return Brakes(np.minimum.accumulate(index[::-1])[::-1], ticks)


@dataclass(frozen=True, eq=False)
class _BrakeDurations:
    """What the durations of all brakes of a motion have to spare; the arguments of `find_brakes`."""

    cell: Cell
    with_object: bool
    gentle: bool

    def shortest(self, q: Array, qd: Array, qdd: Array, dt: float) -> tuple[Ticks, Mask]:
        """Returns the shortest feasible duration of every row's brake [ticks], and whether there is one.

        A grip that no duration spares gets the longest.
        """
        shortest = _shortest(qd, qdd, self.cell.robot.qdd_max)
        ticks = np.ceil(shortest / dt - 1e-9).astype(np.int64)
        done = ticks == 0
        for stretch in STRETCHES:
            todo = np.flatnonzero(~done)
            if len(todo) == 0:
                break
            tried = np.ceil(shortest[todo] * stretch / dt).astype(np.int64)
            duration = tried.astype(np.float64) * dt
            path = brake_path(q[todo], qd[todo], qdd[todo], duration, np.linspace(0.0, 1.0, INSTANTS))
            passed = self._torques_allowed(*path)
            if self.gentle and stretch < STRETCHES[-1]:
                passed &= self._grip_holds(*path)
            ticks[todo] = tried
            done[todo[passed]] = True
        return ticks, done

    def _torques_allowed(self, q: Array, qd: Array, qdd: Array) -> Mask:
        """Returns whether each brake (M,) keeps the torques; those of its first instant are the motion's own."""
        cell = self.cell
        tau = joint_torques(cell.robot, q, qd, qdd, gravity_in_base(cell), payload_of(cell, self.with_object))
        return np.asarray((np.abs(tau[:, 1:]) <= cell.robot.tau_max).all(axis=(1, 2)), np.bool_)

    def _grip_holds(self, q: Array, qd: Array, qdd: Array) -> Mask:
        """Returns whether the grip withstands what it feels along each brake (M,): acceleration against free fall."""
        cell = self.cell
        limit = cell.gripper.hold_acceleration_m_s2
        if limit is None:
            return np.ones(len(q), np.bool_)
        felt = tcp_acceleration(cell.robot, q, qd, qdd, cell.tool.X_FT)[..., :3] - gravity_in_base(cell)
        if len(limit) == 1:
            return np.asarray((np.linalg.norm(felt, axis=-1) <= limit).all(axis=1), np.bool_)
        R_BT = forward(cell.robot, q, cell.tool.X_FT)[..., :3, :3]
        return np.asarray((np.abs(np.einsum("...ji,...j->...i", R_BT, felt)) <= limit).all(axis=(1, 2)), np.bool_)


def _shortest(qd: Array, qdd: Array, qdd_max: Array) -> Array:
    """Returns the duration (M,) [s] at which no acceleration exceeds the arm's: |qd / T + qdd r/2| (1+k(1-2r)) / (1-r).

    The magnitude of qdd is taken: one against the speed shortens a brake by no more than one along it lengthens it.
    """
    peak = 1.0 + SLOPE * (1.0 - 2.0 * RAMP)  # at the end of the first ramp
    room = np.maximum(qdd_max * (1.0 - RAMP) / peak - np.abs(qdd) * RAMP / 2.0, 0.25 * qdd_max)
    return (np.abs(qd) / room).max(axis=1) + np.where(np.abs(qdd).max(axis=1) > REST_SPEED, FADE_S, 0.0)


def _keeps_clear(cell: Cell, q: Array, qd: Array, qdd: Array, T: Array, with_object: bool) -> Mask:
    """Returns whether each brake (M,) keeps joint range and clearance, between the instants too.

    Where the bounds between the instants leave a doubt, there are twice as many, up to `REFINEMENTS` times.
    """
    kept = np.zeros(len(q), np.bool_)
    todo = np.arange(len(q))
    instants = INSTANTS
    for _ in range(REFINEMENTS):
        path = brake_path(q[todo], qd[todo], qdd[todo], T[todo], np.linspace(0, 1, instants))
        clear, broken = _swept(cell, path, T[todo], with_object)
        kept[todo[clear]] = True
        todo = todo[~clear & ~broken]
        instants = 2 * instants - 1
        if len(todo) == 0:
            break
    return kept


def _swept(cell: Cell, path: tuple[Array, Array, Array], T: Array, with_object: bool) -> tuple[Mask, Mask]:
    """Returns for brakes (M, U, 6) whether joint range and clearance are kept, and whether an instant breaks them."""
    position, speed, acceleration = path
    step = (T / (position.shape[1] - 1))[:, None, None]
    bend = _larger(acceleration) * step**2
    low = np.minimum(position[:, :-1], position[:, 1:]) - bend / 8.0
    high = np.maximum(position[:, :-1], position[:, 1:]) + bend / 8.0
    lower = cell.limits.q_lower
    upper = cell.limits.q_upper
    in_range = ((low >= lower) & (high <= upper)).all(axis=(1, 2))
    outside = ((position < lower) | (position > upper)).any(axis=(1, 2))
    clear, broken = keep_clear(cell, SweptPaths(position, _larger(speed) * step + bend, bend), with_object)
    return np.asarray(in_range & clear, np.bool_), np.asarray(outside | broken, np.bool_)


def _larger(values: Array) -> Array:
    """Returns the larger magnitude of each two neighbours along the brakes."""
    return np.maximum(np.abs(values[:, :-1]), np.abs(values[:, 1:]))
