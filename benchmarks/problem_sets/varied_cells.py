"""Random cells unlike the shipped ones, and problems of every kind in them.

Their bases are turned, tilted and raised; they have long tools off the axis, heavy objects and boxes. The same arm,
number and seed give the same cell and the same problems.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.posture import allowed, pose_and_twist, tool_position
from benchmarks.problem_sets.task import Task
from planner.cell import Box, Cell, ToolCapsule
from planner.flight import fly
from planner.geometry import body_model
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix

Vector = NDArray[np.float64]

CELLS_PER_ARM = 3
SPREAD = 1.2
SPEED_SHARE = 0.7  # [rad] around home, [-] of the velocity limit
SPEED_MIN = 0.4
RANGE_MIN = 0.2  # [m/s], [m] of a throw
WINDOW_S = 0.01
TOLERANCE_M = 0.01  # [s], [m] of the robust targets
HOME_CLEARANCE_M = 0.005  # [m] beyond the required clearances, at home: the wrist of a UR5 has 8 mm there
BOXES = 2  # keep-out boxes per cell
KINDS = ("joint", "pose", "point", "target", "robust", "rest")


def varied_tasks(arm: Cell, rank: int, count: int, seed: int) -> list[Task]:
    """Returns `count` problems for one arm; its cells and the kinds of release take turns."""
    cells = [_cell(arm, rank, i, seed) for i in range(CELLS_PER_ARM)]
    streams = [_states(here, np.random.default_rng([seed, rank, i, 1])) for i, here in enumerate(cells)]
    tasks: list[Task] = []
    while len(tasks) < count:
        here, state = next(streams[len(tasks) % CELLS_PER_ARM])
        problem = _problem(here, state, KINDS[len(tasks) // CELLS_PER_ARM % len(KINDS)])
        if problem is not None:
            tasks.append(Task(f"varied/{arm.name}/{len(tasks):04d}", problem, state))
    return tasks


@cache
def _cell(arm: Cell, rank: int, index: int, seed: int) -> Cell:
    rng = np.random.default_rng([seed, rank, index, 0])
    while True:
        plain = replace(_drawn(arm, rng), name=f"{arm.name}-{index}")
        if _clearance(plain) > HOME_CLEARANCE_M:
            return _with_boxes(plain, rng)


def _drawn(arm: Cell, rng: np.random.Generator) -> Cell:
    tilt = rng.uniform(-0.3, 0.3, 2)
    p_FT = rng.uniform([-0.06, -0.06, 0.08], [0.06, 0.06, 0.25])
    R_WB = _rotation(0, tilt[0]) @ _rotation(1, tilt[1]) @ _rotation(2, rng.uniform(-np.pi, np.pi))
    tool = replace(
        arm.tool,
        X_FT=pose(p_FT, rotation_vector_to_matrix(rng.uniform(-0.5, 0.5, 3))),
        mass_kg=float(rng.uniform(0.2, 1.2)),
        capsules=(ToolCapsule(np.zeros(3), 0.85 * p_FT, 0.04),),
    )
    heavy_object = replace(arm.object, mass_kg=float(rng.uniform(0.02, 0.8)))
    return replace(
        arm, X_WB=pose(rng.uniform([-1.0, -1.0, 0.3], [1.0, 1.0, 0.8]), R_WB), tool=tool, object=heavy_object
    )


def _clearance(here: Cell) -> float:
    return float(body_model(here).clearances(here.home[None]).least[0])


def _rotation(axis: int, angle: float) -> Vector:
    return rotation_vector_to_matrix(angle * np.eye(3)[axis])


def _with_boxes(here: Cell, rng: np.random.Generator) -> Cell:
    """Returns the cell with a keep-in box and keep-out boxes within reach, all clear of the home posture."""
    base = here.X_WB[:3, 3]
    home = tool_position(here, here.home)
    reach = float(np.hypot(here.robot.a, here.robot.d).sum())
    room = Box(home - rng.uniform(0.35, 0.9, 3) * reach, home + rng.uniform(0.35, 0.9, 3) * reach)
    found = replace(here, surroundings=replace(here.surroundings, keep_in=(room,)))
    while len(found.surroundings.keep_out) < BOXES:
        centre = base + rng.uniform(-0.9, 0.9, 3) * reach
        half = rng.uniform(0.03, 0.2, 3) * reach
        boxes = (*found.surroundings.keep_out, Box(centre - half, centre + half))
        more = replace(found, surroundings=replace(found.surroundings, keep_out=boxes))
        if _clearance(more) > HOME_CLEARANCE_M:
            found = more
    return found


def _states(here: Cell, rng: np.random.Generator) -> Iterator[tuple[Cell, JointRelease]]:
    limits = here.limits
    while True:
        q = np.clip(here.home + rng.uniform(-SPREAD, SPREAD, 6), limits.q_lower, limits.q_upper)
        qd = rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * limits.qd_max
        if body_model(here).clearances(q[None]).least[0] > 0.0 and allowed(here, q, qd):
            yield here, JointRelease(q, qd)


def _problem(here: Cell, state: JointRelease, kind: str) -> ThrowProblem | None:
    release = _release(here, state, kind)
    if release is None:
        return None
    problem = ThrowProblem(here, here.home, release, here.limits)
    if kind == "robust":
        return replace(problem, release_window_s=WINDOW_S, landing_tolerance_m=TOLERANCE_M)
    return problem


def _release(here: Cell, state: JointRelease, kind: str) -> Release | None:
    X_WT, V_WT = pose_and_twist(here, state.q, state.qd)
    p = X_WT[:3, 3]
    v = V_WT[:3]
    match kind:
        case "joint":
            return state
        case "rest":
            return JointRelease(state.q, np.zeros(6))
        case "pose":
            return PoseRelease(X_WT, V_WT)
        case "point":
            return PointRelease(p, v) if np.linalg.norm(v) > SPEED_MIN else None
    flight = fly(p, v, here.surroundings.floor_z_m, here.surroundings.gravity_m_s2)
    if flight is None or np.linalg.norm((flight.landing_point - p)[:2]) < RANGE_MIN:
        return None
    return TargetRelease(flight.landing_point)
