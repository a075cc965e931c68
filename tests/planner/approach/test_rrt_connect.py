"""Paths of an arm around what stands in its straight way."""

from __future__ import annotations

import itertools
import time
from itertools import pairwise

import numpy as np
import pytest

from planner.approach.rrt_connect import BLOCK, SPACING_RAD, Obstacles, find_path
from planner.cell import Cell, shape_of
from planner.geometry import body_model, tool_pose
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell, with_shapes

START = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
GOAL = START + np.array([1.6, 0.0, 0.0, 0.0, 0.0, 0.0])
LOWER = np.full(6, -3.0)
UPPER = np.full(6, 3.0)
MARGIN_M = 0.01


def among(here: Cell, half_m: float = 0.12) -> Obstacles:
    """A turned cube in the middle of the straight way, with edges of twice `half_m`."""
    centre = tool_pose(here, 0.5 * (START + GOAL))[:3, 3]
    X = pose(centre, rotation_vector_to_matrix(np.array([0.0, 0.0, 0.5])))
    cube = shape_of("box", X, np.full(3, 2.0 * half_m))
    return Obstacles.of(with_shapes(here, cube), MARGIN_M, np.array([START, GOAL]))


def closed(here: Cell) -> tuple[Obstacles, np.ndarray, np.ndarray]:
    """The same, and a joint range that leaves no way around it."""
    narrow = np.array([2.0, 0.02, 0.02, 0.02, 0.02, 0.02])
    return among(here), START - narrow, START + narrow


def test_a_clear_way_is_straight():
    around = Obstacles.of(cell(), MARGIN_M, np.array([START, GOAL]))
    assert np.array_equal(find_path(around, LOWER, UPPER), [START, GOAL])


@pytest.mark.parametrize("name", ["ur5e-sim", "ur5-sim"])
def test_a_shape_is_gone_around_in_clear_pieces(name: str):
    here = cell(name)
    around = among(here)
    path = find_path(around, LOWER, UPPER)
    assert path is not None
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    assert len(path) > 2
    body = body_model(with_shapes(here, *_shapes(around)))
    for a, b in pairwise(path):
        q = a + np.linspace(0.0, 1.0, int(np.abs(b - a).max() / SPACING_RAD) + 2)[:, None] * (b - a)
        clearances = body.clearances(q)
        away = np.abs(q[:, None] - path[[0, -1]]).max(axis=2).min(axis=1)
        assert clearances.least.min() >= 0.0
        assert (clearances.keep_out[away > 0.3] >= 0.8 * MARGIN_M).all()


def _shapes(around: Obstacles):
    rows = around.scene.arrays[3]
    for row in rows:
        yield shape_of("box", pose(row[9:12], row[:9].reshape(3, 3)), row[15:18] - row[12:15])


def test_the_path_is_short():
    path = find_path(among(cell()), LOWER, UPPER)
    assert path is not None
    assert np.abs(np.diff(path, axis=0)).max(axis=1).sum() < 2.0 * np.abs(GOAL - START).max()


def test_the_same_question_has_the_same_answer():
    first, second = (find_path(among(cell()), LOWER, UPPER) for _ in range(2))
    assert first is not None and len(first) > 2
    assert np.array_equal(first, second)


def test_a_search_ends_at_its_deadline(monkeypatch):
    """In vain it looked a thousand times, for seconds beyond the time limit of a request."""
    looks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(looks)))
    assert find_path(*closed(cell()), deadline_s=20.0) is None
    assert next(looks) == 21
    clear = Obstacles.of(cell(), MARGIN_M, np.array([START, GOAL]))
    assert find_path(clear, LOWER, UPPER, deadline_s=0.0) is not None


def test_a_search_ends_when_its_effort_is_spent(monkeypatch):
    """By a count, not by a clock: a busy machine gives up where an idle one does."""
    given = []
    around, lower, upper = closed(cell())
    grow = Obstacles.grow
    monkeypatch.setattr(Obstacles, "grow", lambda self, trees, q: (given.append(len(q)), grow(self, trees, q)))
    assert find_path(around, lower, upper, budget=2000) is None
    assert 0 < len(given) <= 2000 / BLOCK + 1


def test_a_blocked_goal_has_no_path():
    here = cell()
    goal = tool_pose(here, GOAL)[:3, 3]
    ball = shape_of("sphere", pose(goal, np.eye(3)), np.array([0.1, 0.0]))
    assert find_path(Obstacles.of(with_shapes(here, ball), 0.0, np.array([START, GOAL])), LOWER, UPPER) is None


def test_the_range_is_kept():
    lower = LOWER.copy()
    lower[1] = START[1] - 0.1
    path = find_path(among(cell()), lower, UPPER)
    assert path is not None
    assert path[:, 1].min() >= lower[1]


def test_a_wrist_passes_its_straight_posture():
    """A UR5's leaves 0.2 mm there: with a margin of its own, half of all postures had no path to the other half."""
    here = cell("ur5-sim")
    around = among(here)
    ends = np.array([START, GOAL + np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0])])
    assert find_path(Obstacles(around.scene, MARGIN_M, ends), LOWER, UPPER) is not None


def test_thousands_of_shapes_fit():
    """As a scanned scene has them, all around the way at the height of the floor."""
    here = cell()
    places = np.random.default_rng(0).uniform([-3.0, -3.0, -2.0], [3.0, 3.0, -1.0], (5000, 3))
    boxes = [shape_of("box", pose(place, np.eye(3)), np.full(3, 0.05)) for place in places]
    around = Obstacles.of(with_shapes(here, *boxes, *_shapes(among(here))), MARGIN_M, np.array([START, GOAL]))
    path = find_path(around, LOWER, UPPER)
    assert path is not None and len(path) > 2
