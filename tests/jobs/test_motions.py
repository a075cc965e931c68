"""Motions of jobs, planned for real: straight and vertical lines, the release on time, rest at the picks."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from jobs.cycles import PickLines, motion_request
from planner.cell import Cell, load_cell
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory

ROOT = Path(__file__).parents[2]
DOWN = [math.pi, 0.0, 0.0]
LINES = PickLines(0.1, 0.25)
PICKS = [{"position": [0.45, y, 0.1], "rotation_vector": DOWN} for y in (0.2, 0.05)]
TARGET = {"kind": "target", "position": [1.1, -0.2, 0.0]}


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell(ROOT / "cells" / "ur5e-sim.toml")


def planned(cell: Cell, *asked: object, **more: object) -> tuple[ThrowProblem, Trajectory]:
    found = plan(problem_from_request(motion_request(cell.name, *asked, **more), cell))  # type: ignore[arg-type]
    return found.problem, found.trajectory


@pytest.fixture(scope="module")
def approach(cell: Cell) -> Trajectory:
    return planned(cell, cell.home.tolist(), LINES, next_pick=PICKS[0])[1]


@pytest.fixture(scope="module")
def cycle(cell: Cell, approach: Trajectory) -> tuple[ThrowProblem, Trajectory]:
    return planned(cell, approach.q[-1].tolist(), LINES, PICKS[0], TARGET, PICKS[1])


def places(cell: Cell, q: np.ndarray) -> np.ndarray:
    """Returns where the tool centre point is (n, 3) [m], by the arm's table of Denavit and Hartenberg alone."""
    robot = cell.robot
    X = np.broadcast_to(cell.X_WB, (len(q), 4, 4)).copy()
    for joint in range(6):
        X = X @ link(q[:, joint], robot.d[joint], robot.a[joint], robot.alpha[joint])
    return (X @ cell.tool.X_FT)[:, :3, 3]


def link(theta: np.ndarray, d: float, a: float, alpha: float) -> np.ndarray:
    c, s, ca, sa = np.cos(theta), np.sin(theta), math.cos(alpha), math.sin(alpha)
    o, i = np.zeros_like(c), np.ones_like(c)
    rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [o, o + sa, o + ca, o + d], [o, o, o, i]]
    return np.moveaxis(np.array(rows), 2, 0)


def line_ticks(trajectory: Trajectory, number: int) -> slice:
    """Returns the ticks of a line: from its index for its length at its speed."""
    begins = trajectory.passed[number]
    lasts = math.floor((LINES.approach_m - LINES.brake_m) / LINES.speed_m_s * trajectory.sample_rate_hz)
    return slice(begins, begins + lasts + 1)


def assert_on_line(cell: Cell, trajectory: Trajectory, number: int, pick: dict, direction: float) -> None:
    p = places(cell, trajectory.q[line_ticks(trajectory, number)])
    assert len(p) > 100
    np.testing.assert_allclose(p[:, :2], np.tile(pick["position"][:2], (len(p), 1)), atol=1e-5)
    step = direction * LINES.speed_m_s / trajectory.sample_rate_hz
    np.testing.assert_allclose(np.diff(p[:, 2]), step, rtol=1e-3)
    low, high = sorted((p[0, 2], p[-1, 2]))
    height = pick["position"][2]
    assert low == pytest.approx(height + LINES.brake_m, abs=abs(step) + 1e-6)
    assert high == pytest.approx(height + LINES.approach_m, abs=abs(step) + 1e-6)


def assert_at_rest_at(cell: Cell, trajectory: Trajectory, pick: dict) -> None:
    np.testing.assert_allclose(places(cell, trajectory.q[-1:])[0], pick["position"], atol=1e-6)
    np.testing.assert_allclose(trajectory.qd[-1], 0.0, atol=1e-9)


def test_an_approach_comes_straight_down_and_lets_nothing_go(cell: Cell, approach: Trajectory):
    assert_on_line(cell, approach, 0, PICKS[0], -1.0)
    assert_at_rest_at(cell, approach, PICKS[0])


def test_a_cycle_goes_straight_up_throws_and_comes_straight_down(cell: Cell, cycle: tuple[ThrowProblem, Trajectory]):
    _, trajectory = cycle
    assert_on_line(cell, trajectory, 0, PICKS[0], 1.0)
    assert_on_line(cell, trajectory, 2, PICKS[1], -1.0)
    assert_at_rest_at(cell, trajectory, PICKS[1])
    speeds = np.abs(trajectory.qd).max(axis=1)
    assert (speeds[1:-1] > 0.0).all()  # at rest at its picks alone


def test_the_object_of_a_cycle_falls_on_its_target(cell: Cell, cycle: tuple[ThrowProblem, Trajectory]):
    """By the parabola from where the tool is at the release, with the velocity between the samples beside."""
    problem, trajectory = cycle
    k = trajectory.passed[1]
    assert k == trajectory.release_index
    p = places(cell, trajectory.q[k - 1 : k + 2])
    v = (p[2] - p[0]) * trajectory.sample_rate_hz / 2.0
    fall_s = (v[2] + math.sqrt(v[2] ** 2 + 2.0 * problem.gravity * p[1, 2])) / problem.gravity
    landed = p[1, :2] + fall_s * v[:2]
    np.testing.assert_allclose(landed, TARGET["position"][:2], atol=2e-3)


def test_what_is_left_below_a_line_is_braked_on(cell: Cell, cycle: tuple[ThrowProblem, Trajectory]):
    _, trajectory = cycle
    rest = places(cell, trajectory.q[line_ticks(trajectory, 2).stop - 1 :])
    heights = rest[:, 2] - PICKS[1]["position"][2]
    assert heights.min() > -1e-6  # never below the pick
    assert np.linalg.norm(rest[:, :2] - PICKS[1]["position"][:2], axis=1).max() < 0.005


def test_the_last_cycle_ends_at_home(cell: Cell, approach: Trajectory):
    _, trajectory = planned(cell, approach.q[-1].tolist(), LINES, PICKS[0], TARGET)
    np.testing.assert_allclose(trajectory.q[-1], cell.home, atol=1e-9)
