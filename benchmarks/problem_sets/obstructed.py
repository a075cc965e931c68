"""Targets behind walls and in bins that are feasible by construction: some lob over the obstacle is known.

The lob is found by drawing postures and flight times, apart from the planner's own candidates. It keeps the limits of
speed, clears wall and rim with room to spare, and the arm is clear of everything in it and at the start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.reshaped import OTHER_KINDS, reshaped
from benchmarks.problem_sets.task import Task
from planner.cell import Box, Cell
from planner.geometry import body_model, segment_shape_distance, tool_pose
from planner.kinematics import jacobian, singularity_distances
from planner.problem import JointRelease, Opening, TargetRelease, ThrowProblem

Vector = NDArray[np.float64]

KINDS = ("wall", "bin", "wall-bin")
POSTURES = 6000  # drawn for the lob
FLIGHT_TIMES = np.linspace(0.7, 2.6, 14)  # [-] of the slowest throw's
ARC_SAMPLES = 160  # of the arc, at which obstacles are checked
ROOM_M = 0.02  # [m] by which the lob clears wall and rim, besides the object's radius
DISTANCES_M = (0.5, 1.0)
HEIGHTS_M = (0.3, 1.0)
THICKNESSES_M = (0.03, 0.2)  # of walls
WIDTHS_M = (0.6, 2.0)  # of walls
BEHIND_M = (0.1, 0.6)
TARGET_HEIGHTS_M = (0.0, 0.3)  # of targets behind walls
RADII_M = (0.06, 0.25)
RIMS_M = (0.05, 0.4)  # of bins
BIN_DISTANCES_M = (0.5, 1.5)  # of bins without a wall


def obstructed_tasks(here: Cell, count: int, seed: int, shaped: bool = False) -> list[Task]:
    """Returns targets behind walls, in bins and in bins behind walls in turn; the release of least window.

    Args:
        here: the cell, without boxes of its own.
        count: of the tasks.
        seed: of the draws.
        shaped: whether other shapes than boxes along the axes stand in the way; then no bin is without a wall.
    """
    kinds = [KINDS[i % len(KINDS)] for i in range(count)]
    makers = {kind: _feasible(kind, here, np.random.default_rng([seed, k]), shaped) for k, kind in enumerate(KINDS)}
    made = [(kind, next(makers[kind])) for kind in kinds]
    return [Task(f"{kind}/{here.name}/{i:04d}", problem, state) for i, (kind, (problem, state)) in enumerate(made)]


def open_tasks(tasks: list[Task]) -> list[Task]:
    """Returns the same targets without wall and bin."""
    return [Task(f"open-{task.name}", _without_obstacles(task.problem), task.state) for task in tasks]


def _without_obstacles(problem: ThrowProblem) -> ThrowProblem:
    assert isinstance(problem.release, TargetRelease)
    cell = replace(problem.cell, surroundings=replace(problem.cell.surroundings, keep_out=()))
    return replace(problem, cell=cell, release=replace(problem.release, opening=None))


def _feasible(
    kind: str, here: Cell, rng: np.random.Generator, shaped: bool
) -> Iterator[tuple[ThrowProblem, JointRelease]]:
    while True:
        problem = _drawn("wall-bin" if shaped and kind == "bin" else kind, here, rng)
        problem = _reshaped(problem, rng) if shaped else problem
        if body_model(problem.cell_with_bin).clearances(here.home[None]).least[0] < 0.0:
            continue
        lob = _lob(problem, rng)
        if lob is not None:
            yield problem, lob


def _drawn(kind: str, here: Cell, rng: np.random.Generator) -> ThrowProblem:
    """Returns a problem with a random wall or bin, feasible or not."""
    side = rng.integers(2)
    turn = rng.choice([-1.0, 1.0])
    walls = ()
    opening = None
    along = float(rng.uniform(*BIN_DISTANCES_M))
    target = np.empty(3)
    if kind != "wall":
        opening = Opening(float(rng.uniform(*RADII_M)), float(rng.uniform(*RIMS_M)))
    if kind != "bin":
        near, height, thick = (float(rng.uniform(*r)) for r in (DISTANCES_M, HEIGHTS_M, THICKNESSES_M))
        width = float(rng.uniform(*WIDTHS_M))
        aside = float(rng.uniform(-0.3, 0.3))
        lower = np.zeros(3)
        upper = np.full(3, height)
        ends = np.sort(turn * np.array([near, near + thick]))
        lower[side], upper[side] = ends
        lower[1 - side] = aside - width / 2
        upper[1 - side] = aside + width / 2
        walls = (Box(lower, upper),)
        room = 0.0 if opening is None else opening.radius_m
        along = near + thick + room + float(rng.uniform(*BEHIND_M))
    target[side] = turn * along
    target[1 - side] = rng.uniform(-0.4, 0.4)
    target[2] = rng.uniform(*TARGET_HEIGHTS_M)
    cell = replace(here, surroundings=replace(here.surroundings, keep_out=walls))
    return ThrowProblem(cell, here.home, TargetRelease(target, opening=opening), here.limits)


def _reshaped(problem: ThrowProblem, rng: np.random.Generator) -> ThrowProblem:
    """Returns the problem with other shapes about where its walls are, and of their size."""
    around = problem.cell.surroundings
    kind = str(rng.choice(OTHER_KINDS))
    shapes = tuple(shape for box in around.keep_out for shape in reshaped(kind, box, rng))
    return replace(problem, cell=replace(problem.cell, surroundings=replace(around, keep_out=shapes)))


def _lob(problem: ThrowProblem, rng: np.random.Generator) -> JointRelease | None:
    """Returns a joint state that throws the object to the target past every obstacle, None if none was drawn."""
    cell = problem.cell
    limits = problem.limits
    release = problem.release
    assert isinstance(release, TargetRelease)
    q = np.clip(cell.home + rng.uniform(-1, 1, (POSTURES, 6)) * [np.pi, 1.8, 1.8, 2.2, 2.2, np.pi], -6.2, 6.2)
    q = q[singularity_distances(cell.robot, q).minimum >= limits.singularity_distance_min]
    p = tool_pose(cell, q)[:, :3, 3]
    away = release.p_W - p
    t = FLIGHT_TIMES[:, None] * np.sqrt(2.0 * np.linalg.norm(away, axis=1) / problem.gravity)
    v = away / t[..., None] + np.array([0.0, 0.0, 0.5 * problem.gravity]) * t[..., None]
    J = cell.X_WB[:3, :3] @ jacobian(cell.robot, q, cell.tool.X_FT)[:, :3]
    weighted = np.linalg.pinv(J * limits.qd_max) * limits.qd_max[:, None]  # least norm as shares of the limits
    qd = np.einsum("nij,knj->kni", weighted, v)
    slow = (np.linalg.norm(v, axis=-1) <= limits.tcp_speed_max) & (np.abs(qd) <= limits.qd_max).all(axis=-1)
    k, n = np.nonzero(slow & (v[..., 2] < problem.gravity * t))
    good = _passes(problem, release, p[n], v[k, n], t[k, n])
    k = k[good]
    n = n[good]
    clear = body_model(problem.cell_with_bin).clearances(q[n]).least >= 0.0 if len(n) else np.zeros(0, dtype=bool)
    if not clear.any():
        return None
    first = int(np.flatnonzero(clear)[0])
    return JointRelease(q[n[first]], qd[k[first], n[first]])


def _passes(problem: ThrowProblem, release: TargetRelease, p: Vector, v: Vector, t: Vector) -> NDArray[np.bool_]:
    """Returns the mask (n,) of the flights that clear walls and rim with room to spare, sampled densely."""
    s = np.linspace(0.0, 1.0, ARC_SAMPLES) * t[:, None]
    x = p[:, None] + v[:, None] * s[..., None] - 0.5 * problem.gravity * s[..., None] ** 2 * np.array([0.0, 0.0, 1.0])
    thick = problem.cell.object.radius_m + ROOM_M
    good = np.ones(len(p), dtype=bool)
    for shape in problem.cell.surroundings.keep_out:
        good[good] = segment_shape_distance(x[good], x[good], shape).min(axis=1) >= thick
    if release.opening is not None:
        out = np.hypot(x[..., 0] - release.p_W[0], x[..., 1] - release.p_W[1]) - release.opening.radius_m
        over = x[..., 2] - release.p_W[2] - release.opening.rim_height_m
        falling = v[:, None, 2] - problem.gravity * s < 0.0
        wall = np.where(over > 0.0, np.hypot(out, over), np.abs(out))
        inside = (over <= 0.0) & (out < 0.0) & falling
        good &= (inside | (wall >= thick)).all(axis=1)
        good &= ~((over <= 0.0) & (out < 0.0) & ~falling).any(axis=1)
    return good
