"""Approaches to a plan's start, and the obstacles that they avoid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach import APPROACH_SPEED, find_approach
from planner.cell import Box, Cell
from planner.certificate import certify
from planner.geometry import body_model, tool_pose
from tests.planner.approach.conftest import BrakedThrow


def with_box(cell: Cell, centre: np.ndarray, half: float) -> Cell:
    """Returns the cell with a forbidden cube."""
    return replace(cell, surroundings=replace(cell.surroundings, keep_out=(Box(centre - half, centre + half),)))


def tool_position(cell: Cell, q: np.ndarray) -> np.ndarray:
    """Returns the position of the tool centre point (3,) [m]."""
    return tool_pose(cell, q)[:3, 3]


def test_an_arm_at_the_start_does_not_move(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, obstacle = find_approach(throw.cell, start, start)
    assert approach is not None
    assert approach.trajectory is None
    assert not obstacle


def test_a_clear_approach_is_a_straight_move(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, _ = find_approach(throw.cell, start + np.array([0.5, 0, 0, 0, 0, 0]), start)
    assert approach is not None
    assert approach.goal is start
    assert approach.trajectory is None


def test_an_obstacle_in_the_straight_move_is_avoided(throw: BrakedThrow) -> None:
    cell = throw.cell
    start = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    now = start + np.array([1.6, 0, 0, 0, 0, 0])
    blocked = with_box(cell, tool_position(cell, (now + start) / 2.0), 0.12)
    approach, obstacle = find_approach(blocked, now, start)
    assert approach is not None and approach.trajectory is not None and approach.problem is not None
    assert "keep-out box" in obstacle  # in the straight move
    motion = approach.trajectory
    assert motion.q[0] == pytest.approx(now, abs=1e-9)
    assert motion.q[-1] == pytest.approx(start, abs=1e-9)
    assert body_model(blocked).clearances(motion.at(np.linspace(0.0, motion.duration_s, 5000))[0]).least.min() > 0.0
    assert np.abs(motion.qd).max() <= APPROACH_SPEED
    assert certify(approach.problem, motion).valid


def test_where_no_approach_is_found_the_obstacle_is_named(throw: BrakedThrow) -> None:
    cell = throw.cell
    start = throw.trajectory.q[0]
    blocked = with_box(cell, tool_position(cell, start), 0.1)
    approach, obstacle = find_approach(blocked, start + np.array([1.0, 0, 0, 0, 0, 0]), start)
    assert approach is None
    assert "keep-out box" in obstacle


def test_an_approach_beyond_a_joints_range_is_refused(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, obstacle = find_approach(throw.cell, start, start + np.array([0, 0, 7.0, 0, 0, 0]))
    assert approach is None
    assert obstacle
