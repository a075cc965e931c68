"""Throws among turned boxes, cylinders, spheres, capsules and meshes: feasible, as a certified motion is known.

That is planned in the empty cell, or onto a table alone; then shapes are placed beside it, close to the tool's path or
to the flight, wherever the motion's certificate holds with them. A mesh is the boxes that cover it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.random_cells import random_cell_tasks
from benchmarks.problem_sets.reshaped import reshaped
from benchmarks.problem_sets.task import Task
from planner.cell import Box, Cell, Solid, shape_of
from planner.certificate import certify
from planner.errors import Infeasible, SolverFailed
from planner.flight import path
from planner.geometry import tool_state
from planner.planning import plan
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

KINDS = ("box", "cylinder", "box", "cylinder", "sphere", "capsule", "mesh")  # drawn from; box and cylinder are common
ON = (None, "box", None, "cylinder")  # what the target is on, in turn
SHAPES = 4  # of a cell, its table included
SIZES_M = (0.04, 0.4)  # edges, radii and lengths
AWAY_M = 0.35  # [m] at most, from a place on the way to the shape's middle
OUT_M = (0.7, 1.4)  # of targets from the base
TABLE_Z_M = (0.1, 0.5)
DRAWS = 400  # of shapes, before a problem goes with fewer


def shaped_tasks(here: Cell, count: int, seed: int) -> list[Task]:
    """Returns `count` tasks.

    Args:
        here: the cell, without shapes of its own.
        count: number of tasks.
        seed: of the random draws.
    """
    rng = np.random.default_rng([seed, 60])
    drawn = (_drawn(here, ON[number % len(ON)], rng) for number in itertools.count())
    return list(itertools.islice(_tasks("shaped", drawn, rng), count))


def shaped_cell_tasks(count: int, seed: int) -> list[Task]:
    """Returns `count` tasks of every kind in random cells, whose walls and blocks are other shapes."""
    rng = np.random.default_rng([seed, 61])
    tasks = random_cell_tasks(2 * count, max(4, count // 2), seed)
    drawn = (replace(task.problem, cell=_with(task.problem.cell, ())) for task in tasks)
    return list(itertools.islice(_tasks("cells", drawn, rng), count))


def _tasks(group: str, problems: Iterable[ThrowProblem], rng: np.random.Generator) -> Iterator[Task]:
    """Yields those of the problems that are answered, with shapes beside the motion."""
    number = 0
    for problem in problems:
        try:
            motion = plan(problem).trajectory
        except (Infeasible, SolverFailed):
            continue
        state = JointRelease(motion.q[motion.release_index], motion.qd[motion.release_index])
        name = f"{group}/{problem.cell.name}/{number:04d}"
        yield Task(name, _furnished(problem, motion, rng), state, motion)
        number += 1


def _drawn(here: Cell, on: str | None, rng: np.random.Generator) -> ThrowProblem:
    angle = rng.uniform(-np.pi, np.pi)
    target = np.array([*rng.uniform(*OUT_M) * np.array([np.cos(angle), np.sin(angle)]), 0.0])
    shapes: tuple[Solid, ...] = ()
    if on is not None:
        target[2] = rng.uniform(*TABLE_Z_M)
        X = pose(target * [1.0, 1.0, 0.5], rotation_vector_to_matrix(np.array([0.0, 0.0, rng.uniform(-2.0, 2.0)])))
        sizes = [*rng.uniform(0.3, 0.6, 2), target[2]] if on == "box" else [rng.uniform(0.15, 0.3), target[2]]
        shapes = (shape_of(on, X, np.array(sizes)),)
    return ThrowProblem(_with(here, shapes), here.home, TargetRelease(target), here.limits)


def _furnished(problem: ThrowProblem, motion: Trajectory, rng: np.random.Generator) -> ThrowProblem:
    """Returns the problem with shapes beside a known motion."""
    places = _way(problem, motion)
    lacking = SHAPES - len(problem.cell.surroundings.keep_out)
    for _ in range(DRAWS):
        if lacking == 0:
            break
        kind = str(rng.choice(KINDS))
        centre = places[rng.integers(len(places))] + rng.uniform(-AWAY_M, AWAY_M, 3)
        there = problem.cell.surroundings.keep_out
        more = replace(problem, cell=_with(problem.cell, (*there, *_shapes(kind, centre, rng))))
        if certify(more, motion).valid:
            problem = more
            lacking -= 1
    return problem


def _shapes(kind: str, centre: Vector, rng: np.random.Generator) -> tuple[Solid, ...]:
    """Returns a turned shape of a kind at a place, of a mesh the boxes that cover it."""
    if kind == "mesh":
        half = 0.5 * rng.uniform(*SIZES_M, 3)
        return reshaped("mesh", Box(centre - half, centre + half), rng)
    sizes = rng.uniform(*SIZES_M, 3 if kind == "box" else 2)
    sizes = np.array([0.5 * sizes[0], 0.0 if kind == "sphere" else sizes[1]]) if kind != "box" else sizes
    return (shape_of(kind, pose(centre, rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3))), sizes),)


def _way(problem: ThrowProblem, motion: Trajectory) -> Vector:
    """Returns places (n, 3) of the tool's path and of the flight [m]."""
    tool = tool_state(problem.cell, motion.q, motion.qd)
    k = motion.release_index
    flown = path(tool.p_WT[k], tool.v_WT[k], np.arange(0.0, 0.6, 0.02), problem.gravity, problem.drag)
    return np.concatenate([tool.p_WT[::10], flown[flown[:, 2] > problem.plane_z]])


def _with(here: Cell, shapes: tuple[Solid, ...]) -> Cell:
    return replace(here, surroundings=replace(here.surroundings, keep_out=shapes))
