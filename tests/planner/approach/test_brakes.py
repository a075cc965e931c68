"""Brakes from every row: their shape, their limits, and obstacles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach import Brakes, brake_path, find_approach, find_brakes
from planner.cell import Box, Cell
from planner.dynamics import joint_torques, payload_of
from planner.geometry import tool_pose
from planner.trajectory import Trajectory
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
    assert (np.abs(tau[:, late]) <= 1.02 * cell.robot.tau_max).all()


def test_a_throw_is_at_rest_within_150_ms_from_everywhere(throw: BrakedThrow) -> None:
    """Of a request to stop: the wait for a brake that passes, the brake, the lag, and two ticks to notice it."""
    brakes = throw.brakes
    wait = brakes.row - np.arange(len(brakes.row))
    ticks = wait + brakes.ticks[brakes.row] + 2
    assert (ticks * throw.dt + throw.cell.timing.lag_s).max() < 0.150


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


def weak_grip(hold_m_s2: float) -> tuple[Cell, Trajectory]:
    """A cell with a weak grip, and a certified approach in it of which the hardest brake is felt as 32 m/s^2."""
    here = cell("ur5e-sim")
    here = replace(here, gripper=replace(here.gripper, hold_acceleration_m_s2=np.array([hold_m_s2])))
    q0 = [0.86, -1.88, 0.93, -1.83, -1.67, -0.16]
    q1 = [0.07, -1.05, 0.9, -1.67, -1.47, 0.23]
    approach, _ = find_approach(here, np.array(q0), np.array(q1))
    assert approach is not None and approach.trajectory is not None
    return here, approach.trajectory


def felt_m_s2(here: Cell, motion: Trajectory, brakes: Brakes) -> np.ndarray:
    """The most that the grip feels along the brake of each row that moves, by differences of the tool's position."""
    moving = np.flatnonzero(np.abs(motion.qd).max(axis=1) > 0.01)
    states = motion.q[moving], motion.qd[moving], motion.qdd[moving]
    T = brakes.ticks[moving] * motion.dt
    h = 1e-4
    u = np.linspace(0.1, 0.9, 33)
    # One position a brake and instant, at the instant and `h` before and after it.
    before, now, after = (
        np.array([brake_path(*(x[i : i + 1] for x in states), T[i : i + 1], u + s / T[i])[0][0] for i in range(len(T))])
        for s in (-h, 0.0, h)
    )
    p = [tool_pose(here, q.reshape(-1, 6))[:, :3, 3].reshape(*q.shape[:2], 3) for q in (before, now, after)]
    felt = (p[0] - 2.0 * p[1] + p[2]) / h**2 + [0.0, 0.0, 9.81]
    return np.linalg.norm(felt, axis=2).max(axis=1)


@pytest.mark.slow
def test_a_gentle_brake_keeps_the_grip() -> None:
    here, motion = weak_grip(20.0)
    of_motion = (here, motion.q, motion.qd, motion.qdd, motion.dt)
    hard = find_brakes(*of_motion)
    gentle = find_brakes(*of_motion, gentle=True)
    assert felt_m_s2(here, motion, hard).max() > 30.0
    assert felt_m_s2(here, motion, gentle).max() <= 20.01
    assert (gentle.row == np.arange(len(motion.q))).all()
    strong = find_brakes(cell("ur5e-sim"), *of_motion[1:], gentle=True)
    np.testing.assert_array_equal(strong.ticks, hard.ticks)  # 100 m/s^2 are never felt


def test_a_gentle_brake_remains_a_stop() -> None:
    """Where no brake spares the grip it takes 3.5 times as long as the hardest, and no longer."""
    here, motion = weak_grip(11.0)
    of_motion = (here, motion.q, motion.qd, motion.qdd, motion.dt)
    gentle = find_brakes(*of_motion, gentle=True)
    assert felt_m_s2(here, motion, gentle).max() > 11.0
    assert gentle.ticks.max() * motion.dt < 0.15


def test_a_brake_without_the_object_needs_no_room_for_it() -> None:
    """A way back with an empty gripper, where a large object would not be clear, can be braked on every row."""
    here = cell("ur5e-sim")
    big = replace(here, object=replace(here.object, radius_m=0.25))
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    away, _ = find_approach(big, q, q + np.array([0.3, 0, 0, 0, 0, 0]), with_object=False)
    assert away is not None and away.trajectory is not None
    motion = away.trajectory
    of_motion = (big, motion.q, motion.qd, motion.qdd, motion.dt)
    rows = np.arange(len(motion.q))
    assert (find_brakes(*of_motion, with_object=False).row == rows).all()
    assert (find_brakes(*of_motion).row[1:-1] > rows[1:-1]).all()


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
    found = find_brakes(cell, motion.q, motion.qd, motion.qdd, motion.dt)
    np.testing.assert_array_equal(found.row, np.arange(len(motion.q)))
