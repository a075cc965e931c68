"""Problems among keep-out boxes: poses, points and targets, with and without a release window.

Each has one box beside the straight joint path from a random start to a joint state that the release is made from, so
that the box is in the way now and then, but never where the arm starts or releases.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.named_sets import ANYWHERE, build
from benchmarks.problem_sets.posture import tool_position
from benchmarks.problem_sets.task import Task
from planner.cell import Box, Cell
from planner.geometry import body_model
from planner.problem import JointRelease, ThrowProblem

Vector = NDArray[np.float64]

KINDS = ("pose", "point", "target", "robust")  # sets of `named_sets` that the releases are drawn as
WINDOWS = ((0.02, 0.005), (0.009, 0.02))  # [s], [m] window and tolerance, in turn
SIZES_M = (0.04, 0.2)  # [m] half the edges of a box
ROOM_M = 0.01  # [m] beyond the required clearances at start and release
AWAY_M = 0.35  # [m] at most, from the tool's place on the straight joint path to the middle of the box
DRAWS = 200  # boxes drawn before a problem goes without one


def boxed_tasks(count: int, seed: int) -> list[Task]:
    """Returns `count` tasks, spread over kinds and arms.

    Args:
        count: number of tasks.
        seed: of the random draws.
    """
    rng = np.random.default_rng([seed, 14])
    per_kind = [len(part) for part in np.array_split(np.arange(count), len(KINDS))]
    groups = [build(kind + ANYWHERE, share, seed) for kind, share in zip(KINDS, per_kind, strict=True)]
    return [task for i in range(max(per_kind)) for group in groups for task in _boxed(group[i : i + 1], rng)]


def _boxed(tasks: list[Task], rng: np.random.Generator) -> Iterator[Task]:
    """Yields tasks with a box, and with one of `WINDOWS` where they have a window."""
    for task in tasks:
        assert task.state is not None
        problem = task.problem
        number = int(task.name.split("/")[-1])
        if problem.is_robust:
            window_s, tolerance_m = WINDOWS[number % len(WINDOWS)]
            problem = replace(problem, release_window_s=window_s, landing_tolerance_m=tolerance_m)
        yield Task(f"boxed-{task.name}", _with_box(problem, task.state, rng), task.state)


def _with_box(problem: ThrowProblem, state: JointRelease, rng: np.random.Generator) -> ThrowProblem:
    here = problem.cell
    ends = np.array([problem.start, state.q])
    has_room = body_model(here).clearances(ends).least.min() > ROOM_M  # otherwise no box leaves it any
    for _ in range(DRAWS):
        on_path = tool_position(here, problem.start + rng.uniform() * (state.q - problem.start))
        centre = on_path + rng.uniform(-AWAY_M, AWAY_M, 3)
        half = rng.uniform(*SIZES_M, 3)
        if not has_room:
            continue
        boxed = _cell_with(here, Box(centre - half, centre + half))
        if body_model(boxed).clearances(ends).least.min() > ROOM_M:
            return replace(problem, cell=boxed)
    return problem


def _cell_with(here: Cell, box: Box) -> Cell:
    return replace(here, surroundings=replace(here.surroundings, keep_out=(box,)))
