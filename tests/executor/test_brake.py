"""Brakes from every row: their shape, their limits, what stands in their way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach.brakes import brake_way, brakes
from planner.cell import Box
from planner.dynamics import joint_torques
from tests.executor.conftest import Prepared


def test_speed_and_acceleration_are_the_derivatives_of_the_way() -> None:
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 4, 6))
    T, u = np.array([0.1, 0.2, 0.3, 0.4]), np.linspace(0.05, 0.95, 7)
    h = 1e-6
    _, speed, acceleration = brake_way(q, qd, qdd, T, u)
    later, later_speed, _ = brake_way(q, qd, qdd, T, u + h)
    earlier, earlier_speed, _ = brake_way(q, qd, qdd, T, u - h)
    per_second = 2 * h * T[:, None, None]
    assert (later - earlier) / per_second == pytest.approx(speed, abs=1e-6)
    assert (later_speed - earlier_speed) / per_second == pytest.approx(acceleration, abs=1e-5)
    begin, begin_speed, begin_acceleration = brake_way(q, qd, qdd, T, np.array([0.0]))
    assert begin[:, 0] == pytest.approx(q)
    assert begin_speed[:, 0] == pytest.approx(qd)
    assert begin_acceleration[:, 0] == pytest.approx(qdd)
    assert brake_way(q, qd, qdd, T, np.array([1.0]))[1] == pytest.approx(np.zeros((4, 1, 6)))


def test_every_brake_in_force_is_within_the_arm(prepared: Prepared) -> None:
    rows, ways, cell, dt = prepared.rows, prepared.brakes, prepared.cell, prepared.job.dt
    used = np.unique(ways.row)
    u = np.linspace(0.0, 1.0, 101)
    moving = used[ways.ticks[used] > 0]
    way, speed, acceleration = brake_way(rows.q[moving], rows.qd[moving], rows.qdd[moving], ways.ticks[moving] * dt, u)
    assert (way >= cell.limits.q_lower).all()
    assert (way <= cell.limits.q_upper).all()
    assert (np.abs(speed) <= 1.1 * cell.robot.qd_max).all()
    assert (np.abs(acceleration) <= 1.02 * cell.robot.qdd_max).all()
    gravity_B = cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, -9.81])
    tau = joint_torques(cell.robot, way, speed, acceleration, gravity_B, prepared.payload)
    late = u > 0.05  # at its very start a brake bears what the plan bears
    assert (np.abs(tau[:, late]) <= 1.02 * cell.limits.tau_max).all()


def test_almost_every_row_has_a_brake_of_its_own(prepared: Prepared) -> None:
    wait = prepared.brakes.row - np.arange(len(prepared.brakes.row))
    assert wait.min() == 0
    assert wait.max() * prepared.job.dt < 0.1, "an abort would wait this long for a brake that passes"


def test_where_a_brake_would_hit_something_the_plan_is_flown_on(prepared: Prepared) -> None:
    cell, rows = prepared.cell, prepared.rows
    low = replace(cell, surroundings=replace(cell.surroundings, keep_out=(Box(np.full(3, -5.0), np.full(3, 5.0)),)))
    ways = brakes(low, prepared.payload, rows.q, rows.qd, rows.qdd, prepared.job.dt)
    moving = np.flatnonzero(np.abs(rows.qd).max(axis=1) > 1e-3)
    assert (ways.row[moving] > moving[-1]).all()


def test_at_rest_there_is_nothing_to_brake(prepared: Prepared) -> None:
    assert prepared.brakes.row[0] == 0
    assert prepared.brakes.ticks[0] == 0
    assert prepared.brakes.row[-1] == len(prepared.rows.q) - 1
