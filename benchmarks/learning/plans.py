"""Throws planned by Fling for the benchmark of what is learnt: soonest ones, and ones with a release window."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.cell import Cell
from planner.cell_folder import default_cells_folder, open_cell
from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory

CELL = "ur5e-sim"
TARGETS_SEED = 20261122  # of the targets, which are the same for all hidden cells
DISTANCE_M = (1.0, 2.0)  # [m] from the base to a target on the floor
WINDOWS_S = (0.0, 0.010, 0.020)  # [s] half widths: the soonest throw, and two robust ones
TOLERANCE_M = 0.03  # [m] within which a robust throw lands over its window


@dataclass(frozen=True, eq=False)
class PlannedThrow:
    """One plan by Fling, and the half width of its release window [s]."""

    problem: ThrowProblem
    trajectory: Trajectory
    window_s: float


def benchmark_cell() -> Cell:
    """Returns the cell of the benchmark."""
    return open_cell(default_cells_folder() / f"{CELL}.toml")


def planned_throws(count: int, windows_s: Sequence[float] = WINDOWS_S, backend: str = "auto") -> list[PlannedThrow]:
    """Returns `count` throws of each window at targets all around, planned by Fling; refused ones are left out."""
    cell = benchmark_cell()
    rng = np.random.default_rng(TARGETS_SEED)
    throws = []
    for _ in range(count):
        distance = rng.uniform(*DISTANCE_M)
        direction = rng.uniform(-np.pi, np.pi)
        target = [distance * np.cos(direction), distance * np.sin(direction), 0.0]
        for window in windows_s:
            request = {"cell": CELL, "release": {"kind": "target", "position": target}, "backend": backend}
            request |= {"release_window_s": window} | ({"landing_tolerance_m": TOLERANCE_M} if window else {})
            problem = problem_from_request(request, cell)
            try:
                throws.append(PlannedThrow(problem, plan(problem).trajectory, window))
            except (Infeasible, SolverFailed):
                continue
    return throws


def kept_throws(file: Path, count: int) -> list[PlannedThrow]:
    """Returns the throws that a file keeps; plans and writes them where there is none."""
    if not file.exists():
        throws = planned_throws(count)
        states = [(t.window_s, t.problem.release, vars_of(t.trajectory)) for t in throws]
        file.write_bytes(pickle.dumps(states))
    cell = benchmark_cell()
    found = []
    for window, release, samples in pickle.loads(file.read_bytes()):
        problem = ThrowProblem(cell, samples["q"][0], release, cell.limits, window, TOLERANCE_M if window else 0.0)
        found.append(PlannedThrow(problem, Trajectory(**samples), window))
    return found


def vars_of(trajectory: Trajectory) -> dict:
    """Returns the fields of a trajectory, without what it has cached."""
    names = ("sample_rate_hz", "q", "qd", "qdd", "release_index")
    return {name: getattr(trajectory, name) for name in names}
