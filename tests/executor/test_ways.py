"""Ways to the start, and what they keep clear of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach.approach import SPEED, find_way
from planner.approach.swept_clearance import Space, Ways
from planner.cell import Box, Cell
from planner.certificate import certify
from planner.geometry.body import clearances
from planner.kinematics import forward
from tests.executor.conftest import Prepared


def with_box(cell: Cell, centre: np.ndarray, half: float) -> Cell:
    """Returns the cell with a forbidden cube."""
    return replace(cell, surroundings=replace(cell.surroundings, keep_out=(Box(centre - half, centre + half),)))


def hand(cell: Cell, q: np.ndarray) -> np.ndarray:
    """Returns where the tool centre point is (3,) [m]."""
    return (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:3, 3]


def test_an_arm_at_the_start_goes_nowhere(prepared: Prepared) -> None:
    start = prepared.trajectory.q[0]
    way, hit = find_way(Space(prepared.cell), start, start)
    assert way is not None
    assert way.trajectory is None
    assert not hit


def test_a_clear_way_is_a_straight_move(prepared: Prepared) -> None:
    start = prepared.trajectory.q[0]
    way, _ = find_way(Space(prepared.cell), start + np.array([0.5, 0, 0, 0, 0, 0]), start)
    assert way is not None
    assert way.goal is start
    assert way.trajectory is None


def test_what_stands_in_the_straight_way_is_gone_around(prepared: Prepared) -> None:
    cell = prepared.cell
    start = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    now = start + np.array([1.6, 0, 0, 0, 0, 0])
    blocked = with_box(cell, hand(cell, (now + start) / 2.0), 0.12)
    way, hit = find_way(Space(blocked), now, start)
    assert way is not None and way.trajectory is not None and way.problem is not None
    assert "keep-out box" in hit  # what the straight move would have hit
    motion = way.trajectory
    assert motion.q[0] == pytest.approx(now, abs=1e-9)
    assert motion.q[-1] == pytest.approx(start, abs=1e-9)
    assert clearances(blocked, motion.at(np.linspace(0.0, motion.duration_s, 5000))[0]).least.min() > 0.0
    assert np.abs(motion.qd).max() <= SPEED
    assert certify(way.problem, motion).valid


def test_no_way_names_what_stands_there(prepared: Prepared) -> None:
    cell = prepared.cell
    start = prepared.trajectory.q[0]
    blocked = with_box(cell, hand(cell, start), 0.1)
    way, hit = find_way(Space(blocked), start + np.array([1.0, 0, 0, 0, 0, 0]), start)
    assert way is None
    assert "keep-out box" in hit


def test_a_way_beyond_a_joints_range_is_no_way(prepared: Prepared) -> None:
    start = prepared.trajectory.q[0]
    way, hit = find_way(Space(prepared.cell), start, start + np.array([0, 0, 7.0, 0, 0, 0]))
    assert way is None
    assert hit


@pytest.mark.parametrize("seed", range(4))
def test_between_the_looked_at_positions_the_bound_holds(prepared: Prepared, seed: int) -> None:
    """Values at 100 positions in between are never below what was promised."""
    rng = np.random.default_rng(seed)
    cell = with_box(prepared.cell, np.array([0.5, 0.0, 0.6]), 0.1)
    cell = replace(cell, surroundings=replace(cell.surroundings, keep_in=(Box(np.full(3, -2.0), np.full(3, 2.0)),)))
    space = Space(cell)
    a = cell.home + rng.uniform(-0.5, 0.5, 6)
    b = a + rng.uniform(-0.3, 0.3, 6)
    fine = space._bounds(Ways.straight(np.linspace(a, b, 101)[None]))
    coarse = space._bounds(Ways.straight(np.stack([a, b])[None]))
    for (label, _, promised, _), (_, values, _, _) in zip(coarse, fine, strict=True):
        assert values.min() >= promised.min() - 1e-12, label
