"""Brakes from every row: their shape, their limits, and obstacles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach import brake_path, find_approach, find_brakes, line_stop
from planner.cell import Box
from planner.dynamics import joint_torques, payload_of
from planner.geometry import tool_pose
from tests.planner.approach.conftest import BrakedThrow, near_a_box
from tests.planner.problems import cell


def test_speed_and_acceleration_are_the_derivatives_of_the_path() -> None:
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 4, 6))
    T = np.array([0.1, 0.2, 0.3, 0.4])
    u = np.linspace(0.05, 0.95, 7)
    h = 1e-6
    _, speed, acceleration = brake_path(q, qd, qdd, T, u)
    later, later_speed, _ = brake_path(q, qd, qdd, T, u + h)
    earlier, earlier_speed, _ = brake_path(q, qd, qdd, T, u - h)
    per_second = 2 * h * T[:, None, None]
    assert (later - earlier) / per_second == pytest.approx(speed, abs=1e-6)
    assert (later_speed - earlier_speed) / per_second == pytest.approx(acceleration, abs=1e-5)
    begin, begin_speed, begin_acceleration = brake_path(q, qd, qdd, T, np.array([0.0]))
    assert begin[:, 0] == pytest.approx(q)
    assert begin_speed[:, 0] == pytest.approx(qd)
    assert begin_acceleration[:, 0] == pytest.approx(qdd)
    assert brake_path(q, qd, qdd, T, np.array([1.0]))[1] == pytest.approx(np.zeros((4, 1, 6)))


def test_every_brake_in_force_is_within_the_arm(throw: BrakedThrow) -> None:
    cell = throw.cell
    ticks = throw.brakes.ticks
    used = np.unique(throw.brakes.row)
    u = np.linspace(0.0, 1.0, 101)
    moving = used[ticks[used] > 0]
    states = throw.q[moving], throw.qd[moving], throw.qdd[moving]
    q, qd, qdd = brake_path(*states, ticks[moving] * throw.dt, u)
    assert (q >= cell.limits.q_lower).all()
    assert (q <= cell.limits.q_upper).all()
    assert (np.abs(qd) <= 1.1 * cell.robot.qd_max).all()
    assert (np.abs(qdd) <= 1.02 * cell.robot.qdd_max).all()
    gravity_B = cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, -9.81])
    tau = joint_torques(cell.robot, q, qd, qdd, gravity_B, payload_of(cell, with_object=True))
    late = u > 0.05  # the torque of its first instants is the plan's own
    assert (np.abs(tau[:, late]) <= 1.02 * cell.limits.tau_max).all()


def test_almost_every_row_has_a_brake_of_its_own(throw: BrakedThrow) -> None:
    wait = throw.brakes.row - np.arange(len(throw.brakes.row))
    assert wait.min() == 0
    assert wait.max() * throw.dt < 0.1, "an abort would wait this long for a brake that passes"


def test_where_every_brake_collides_the_plan_continues_to_its_end(throw: BrakedThrow) -> None:
    cell = throw.cell
    walled = replace(cell, surroundings=replace(cell.surroundings, keep_out=(Box(np.full(3, -5.0), np.full(3, 5.0)),)))
    found = find_brakes(walled, throw.q, throw.qd, throw.qdd, throw.dt)
    moving = np.flatnonzero(np.abs(throw.qd).max(axis=1) > 1e-3)
    assert (found.row[moving] > moving[-1]).all()


@pytest.mark.parametrize(("share", "hardest"), [(1.0, 10.0), (0.7, 7.0)])
def test_a_stop_on_a_line_keeps_the_torques_at_any_speed(share: float, hardest: float) -> None:
    """The arm comes down stretched; with less torque it may stop less hard."""
    here = cell("ur5e-sim")
    here = replace(here, limits=replace(here.limits, tau_max=share * here.limits.tau_max))
    q = np.linspace([0.1, -1.3, 0.2, -1.2, -1.57, 0.0], [0.0, -0.6, 0.3, -1.2, -1.57, 0.0], 50)
    line = (q[-1] - q[0]) / 0.7
    stop = line_stop(here, q, np.tile(line, (50, 1)), 0.5)
    payload = payload_of(here, with_object=True)
    falling = np.array([0.0, 0.0, -9.81])
    for speed in np.linspace(0.0, 1.0, 6):
        tau = joint_torques(here.robot, q, speed * line, -stop * line, falling, payload)
        assert (np.abs(tau) <= here.limits.tau_max).all()
    assert 0.5 < stop <= hardest
    assert stop == 10.0 or share < 1.0


def test_a_stop_on_a_line_keeps_the_grip() -> None:
    """On this certified approach a stop at 10 rad/s^2 is felt as 18.9 m/s^2."""
    here = cell("ur5e-sim")
    here = replace(here, gripper=replace(here.gripper, hold_acceleration_m_s2=np.array([15.0])))
    q0 = [0.86, -1.88, 0.93, -1.83, -1.67, -0.16]
    q1 = [0.07, -1.05, 0.9, -1.67, -1.47, 0.23]
    approach, _ = find_approach(here, np.array(q0), np.array(q1))
    assert approach is not None and approach.trajectory is not None
    q = approach.trajectory.q
    qd = approach.trajectory.qd
    stop = line_stop(here, q, qd, 1.4)
    assert 1.4 <= stop < 10.0
    assert line_stop(cell("ur5e-sim"), q, qd, 1.4) == 10.0
    leading = np.abs(qd).max(axis=1, keepdims=True)
    moving = leading[:, 0] > 0.01
    h = 1e-4
    line = qd[moving] / leading[moving]
    before, now, after = (
        tool_pose(here, q[moving] + t * qd[moving] - t**2 / 2.0 * stop * line)[:, :3, 3] for t in (-h, 0.0, h)
    )
    felt = (before - 2.0 * now + after) / h**2 + [0.0, 0.0, 9.81]
    assert np.linalg.norm(felt, axis=1).max() <= 15.01


def test_at_rest_there_is_nothing_to_brake(throw: BrakedThrow) -> None:
    assert throw.brakes.row[0] == 0
    assert throw.brakes.ticks[0] == 0
    assert throw.brakes.row[-1] == len(throw.q) - 1


def test_brakes_barely_clear_are_accepted(throw: BrakedThrow) -> None:
    """Along a box, 0.1 mm beyond the clearance: coarse instants alone leave a doubt."""
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    cell = near_a_box(throw.cell, q, 1e-4)
    away, _ = find_approach(cell, q, q + np.array([0.3, 0, 0, 0, 0, 0]))
    assert away is not None and away.trajectory is not None
    motion = away.trajectory
    found = find_brakes(cell, motion.q, motion.qd, motion.qdd, motion.dt, every=10)
    np.testing.assert_array_equal(found.row[::10], np.arange(len(motion.q))[::10])
