"""Paths through a plane with walls, and around a box with a real arm."""

from __future__ import annotations

import itertools
import time
from itertools import pairwise

import numpy as np
import pytest

from planner.approach.rrt_connect import find_path

LOWER = np.array([-5.0, -5.0])
UPPER = np.array([5.0, 5.0])
START = np.array([-1.0, 0.0])
GOAL = np.array([1.0, 0.0])


def wall(height: float, gap: tuple[float, float] = (9.0, 9.0)):
    """A wall at x = 0 as high as `height` to both sides, with a gap."""

    def clear(a, b):
        if (a[0] > 0.0) == (b[0] > 0.0):
            return True
        y = a[1] + (b[1] - a[1]) * a[0] / (a[0] - b[0])
        return abs(y) > height or gap[0] < y < gap[1]

    return clear


def test_a_clear_way_is_straight():
    path = find_path(lambda a, b: True, START, GOAL, LOWER, UPPER)
    assert np.array_equal(path, [START, GOAL])


@pytest.mark.parametrize("clear", [wall(0.8), wall(9.0, (0.6, 0.9))], ids=["around", "through the gap"])
def test_a_wall_is_gone_around_in_clear_pieces(clear):
    path = find_path(clear, START, GOAL, LOWER, UPPER)
    assert path is not None
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    assert len(path) > 2
    assert all(clear(a, b) for a, b in pairwise(path))


def test_the_path_is_short():
    path = find_path(wall(0.8), START, GOAL, LOWER, UPPER)
    assert path is not None
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length < 1.2 * 2.0 * np.hypot(1.0, 0.8)  # the shortest: over the wall's end


def test_the_same_question_has_the_same_answer():
    first, second = (find_path(wall(0.8), START, GOAL, LOWER, UPPER) for _ in range(2))
    assert np.array_equal(first, second)


def test_a_search_ends_at_its_deadline(monkeypatch):
    """In vain it looked a thousand times, for seconds beyond the time limit of a request."""
    looks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(looks)))
    assert find_path(wall(9.0), START, GOAL, LOWER, UPPER, deadline_s=20.0) is None
    assert next(looks) == 21
    assert find_path(lambda a, b: True, START, GOAL, LOWER, UPPER, deadline_s=0.0) is not None


def test_a_closed_wall_and_a_blocked_goal_have_no_path():
    assert find_path(wall(9.0), START, GOAL, LOWER, UPPER) is None
    assert find_path(lambda a, b: b[0] < 0.5 and a[0] < 0.5, START, GOAL, LOWER, UPPER) is None


def test_the_range_is_kept():
    path = find_path(wall(0.8), START, GOAL, np.array([-5.0, -0.5]), UPPER)
    assert path is not None
    assert path[:, 1].min() >= -0.5
    assert path[:, 1].max() > 0.8
