"""Path search in joint space (RRT-Connect): straight pieces between postures, clear of floor, boxes and the arm itself.

Two trees, one from each end, grow towards random postures and towards each other until they meet; the path is then
shortened wherever a straight piece is clear. Sources: Kuffner and LaValle, RRT-Connect: an efficient approach to
single-query path planning, ICRA 2000; Geraerts and Overmars, Creating high-quality paths for motion planning, IJRR 2007
(shortcuts). The random numbers have a given seed, so the same problem has the same path.

Pieces are checked at postures `SPACING_RAD` apart, with a margin that falls to nothing at both ends: an end which the
certificate accepts is never excluded. The certificate proves the motion along the path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.cell import Cell
from planner.geometry import body_model

Edge = Callable[[Array, Array], bool]

SPACING_RAD = 0.02  # [rad] between checked postures: 26 mm at a reach of 1.3 m
STEP_RAD = 0.3  # [rad] by which a tree grows at most in one step
NEAR_END_RAD = 0.2  # [rad] distance from an end within which the margin grows from nothing: 5 cm at a lever of 0.25 m
SHORTCUTS = 200  # [-] straight pieces tried
SEED = 0  # of the random postures


@dataclass(frozen=True)
class Effort:
    """What one search for a path spends.

    Attributes:
        growths: random postures tried before giving up; a thousand take up to two seconds.
        around_rad: how far they lie beyond both ends in every joint [rad].
    """

    growths: int = 1000
    around_rad: float = 1.5


FIRST_EFFORT = Effort()


def is_clear(cell: Cell, margin_m: float, ends: Array, with_object: bool = True) -> Edge:
    """Returns a test of whether a straight piece between two postures keeps `margin_m` beyond the cell's clearance.

    Args:
        cell: the robot station.
        margin_m: kept beyond the clearance [m], less within `NEAR_END_RAD` of the ends.
        ends: start and goal of the path (2, 6) [rad].
        with_object: whether the object is in the tool.
    """
    body = body_model(cell)

    def clear(a: Array, b: Array) -> bool:
        count = int(np.ceil(np.abs(b - a).max() / SPACING_RAD)) + 1
        q = a + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (b - a)
        away = np.abs(q[:, None] - ends).max(axis=2).min(axis=1)
        return bool((body.clearances(q, with_object).least >= margin_m * np.minimum(away / NEAR_END_RAD, 1.0)).all())

    return clear


def find_path(
    clear: Edge,
    start: Array,
    goal: Array,
    lower: Array,
    upper: Array,
    effort: Effort = FIRST_EFFORT,
    deadline_s: float = math.inf,
) -> Array | None:
    """Returns postures (K, n) [rad] from `start` to `goal` with clear straight pieces; None if none are found.

    Args:
        clear: whether a straight piece is clear.
        start, goal: (n,) [rad].
        lower, upper: joint range (n,) [rad].
        effort: where to look, and how long.
        deadline_s: on `time.perf_counter`; a search that has not met by then ends.
    """
    if clear(start, goal):
        return np.array([start, goal])
    if not (clear(start, start) and clear(goal, goal)):
        return None
    rng = np.random.default_rng(SEED)
    low = np.maximum(np.minimum(start, goal) - effort.around_rad, lower)
    high = np.minimum(np.maximum(start, goal) + effort.around_rad, upper)
    here = _Tree(start)
    there = _Tree(goal)
    for growth in range(effort.growths):
        if time.perf_counter() >= deadline_s:
            return None
        new = here.grow(rng.uniform(low, high), clear)
        if new is not None and (met := there.reach(here.q[new], clear)) is not None:
            path = [*here.branch(new)[::-1], *there.branch(met)[1:]]
            return _shortened(path if growth % 2 == 0 else path[::-1], clear, rng)
        here, there = there, here
    return None


class _Tree:
    """Postures, each with the index of its parent."""

    def __init__(self, root: Array) -> None:
        self.q = np.array([root])
        self.parent = [-1]

    def grow(self, towards: Array, clear: Edge) -> int | None:
        """Takes one step towards a posture; returns the index of the new one, None if the step is not clear."""
        near = int(np.linalg.norm(self.q - towards, axis=1).argmin())
        step = towards - self.q[near]
        new = self.q[near] + step * min(1.0, STEP_RAD / max(float(np.abs(step).max()), STEP_RAD))
        if not clear(self.q[near], new):
            return None
        self.q = np.vstack([self.q, new])
        self.parent.append(near)
        return len(self.parent) - 1

    def reach(self, goal: Array, clear: Edge) -> int | None:
        """Grows towards a posture until it is reached; returns its index, None if a step is not clear."""
        while (new := self.grow(goal, clear)) is not None:
            if np.array_equal(self.q[new], goal) or np.abs(self.q[new] - goal).max() < 1e-12:
                return new
        return None

    def branch(self, index: int) -> list[Array]:
        """Returns the postures from `index` back to the root."""
        postures = []
        while index >= 0:
            postures.append(self.q[index])
            index = self.parent[index]
        return postures


def _shortened(path: list[Array], clear: Edge, rng: np.random.Generator) -> Array:
    """Returns the path with random shortcuts by clear straight pieces."""
    for _ in range(SHORTCUTS):
        if len(path) == 2:
            break
        first, last = sorted(rng.uniform(0.0, len(path) - 1, 2))
        i = int(first)
        j = int(last)
        if i == j:
            continue
        a, b = (path[k] + (x - k) * (path[k + 1] - path[k]) for k, x in ((i, first), (j, last)))
        if clear(a, b):
            path = [*path[: i + 1], a, b, *path[j + 1 :]]
    return _without_corners(path, clear)


def _without_corners(path: list[Array], clear: Edge) -> Array:
    """Returns the path without the postures that can be skipped: the motion stops at each."""
    kept = [path[0]]
    at = 0
    while at < len(path) - 1:
        at = next(k for k in range(len(path) - 1, at, -1) if k == at + 1 or clear(path[at], path[k]))
        kept.append(path[at])
    return np.array(kept)
