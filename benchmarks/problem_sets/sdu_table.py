"""Problem sets of a tossing table from a semester project at the University of Southern Denmark.

`sdu_table.json` has the facts: table, targets, release points, and the results of the project's own planner. Targets
are requested with the project's minimum elevation and horizontal distance, on the cell `sdu-table` at 5 rad/s^2.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.problem_sets.task import Task
from planner.cell import Cell
from planner.problem import TargetRelease, ThrowProblem

TABLE = Path(__file__).parent / "sdu_table.json"
PAIR_TIME_LIMIT_S = 2.0  # [s] for one of the 2 x 2,800 pairs


@cache
def sdu_facts() -> dict[str, Any]:
    """Returns the content of `sdu_table.json`."""
    return json.loads(TABLE.read_text(encoding="utf-8"))


def tasks(name: str, cell: Cell, count: int, seed: int) -> list[Task]:
    """Returns the tasks of `sdu-near` (28), `sdu-far` (35), or `count` of the 2,800 of a set of pairs."""
    part = sdu_facts()["near" if "near" in name else "far"]
    if not name.endswith("pairs"):
        return [Task(f"{name}/sdu-table/{i:04d}", _problem(cell, part, p)) for i, p in enumerate(part["targets"])]
    pairs = [(r, p) for p in part["targets"] for r in part["release_points"]]
    order = np.random.default_rng(seed).permutation(len(pairs))[:count]
    return [Task(f"{name}/sdu-table/{i:04d}", _problem(cell, part, pairs[i][1], pairs[i][0])) for i in order]


def _problem(cell: Cell, part: dict[str, Any], target: list[float], place: list[float] | None = None) -> ThrowProblem:
    release = TargetRelease(
        p_W=np.array(target),
        min_elevation_rad=np.radians(sdu_facts()["planner_of_the_source"]["release_elevation_min_deg"]),
        min_horizontal_distance_m=part["min_horizontal_distance_m"],
        release_position=None if place is None else np.array(place),
    )
    limit = 5.0 if place is None else PAIR_TIME_LIMIT_S
    return ThrowProblem(cell, cell.home, release, cell.limits, time_limit_s=limit)
