"""Throws that get another target while they run, searched for anew and moved: `python -m benchmarks.retargeted_throws`.

    python -m benchmarks.retargeted_throws --count 48 --seed 0 [--resume]

A throw of a shipped cell is planned; from a random tick before its release, it is to hit a place 2 to 10 cm beside its
target. Told are the processor times of the planner's whole answer and the releases, without the running throw and with
it. Rows stay on the disk. How long a retarget takes in real time is measured by `benchmarks.streaming.retargets`.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.numbered import measured_rows, numbered_parser
from jobs.planning import PlanningJob, solve
from planner.cell import Cell, CellSource, cell_of, read_source
from planner.errors import Infeasible, PlannerError
from planner.planning import SearchHints, plan
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

ROOT = Path(__file__).parents[1]
ROWS = ROOT / "build" / "benchmarks" / "retargeted_throws.jsonl"
# Cells, and a length [m] that their targets' distances are shares of: about the arm's reach.
CELLS = {"ur3e-sim": 0.5, "ur5-sim": 0.85, "ur5e-sim": 0.85, "ur10e-sim": 1.3, "ur15-sim": 1.3, "sdu-table": 0.85}
DISTANCES = (1.05, 1.6)  # [-]
TO_THE_SIDE_RAD = 0.5
BEGUN = (0.05, 0.9)  # [-] of the launch, at the retarget
SHIFTS_M = (0.02, 0.1)


def running_throw(cell: Cell, reach_m: float, rng: np.random.Generator) -> tuple[Trajectory, np.ndarray]:
    """Returns what is left of a throw, and its target (3,) [m]."""
    while True:
        angle = rng.uniform(-TO_THE_SIDE_RAD, TO_THE_SIDE_RAD)
        level = reach_m * rng.uniform(*DISTANCES) * np.array([np.cos(angle), np.sin(angle)])
        place = np.append(level, cell.surroundings.floor_z_m)
        try:
            whole = plan(
                ThrowProblem(cell, cell.home, TargetRelease(place), cell.limits), SearchHints(offers_nearest=False)
            ).trajectory
        except Infeasible:
            continue
        return whole.since(int(rng.uniform(*BEGUN) * whole.release_index)), place


def job_of(number: int, seed: int) -> PlanningJob:
    """Returns a retarget with the throw that runs."""
    name = list(CELLS)[number % len(CELLS)]
    source: CellSource = read_source(ROOT / "cells" / f"{name}.toml")
    rng = np.random.default_rng([seed, number])
    left, place = running_throw(cell_of(source), CELLS[name], rng)
    angle = rng.uniform(-np.pi, np.pi)
    place[:2] += rng.uniform(*SHIFTS_M) * np.array([np.cos(angle), np.sin(angle)])
    start = {
        "positions": left.q[0].tolist(),
        "velocities": left.qd[0].tolist(),
        "accelerations": left.qdd[0].tolist(),
    }
    request = {"cell": name, "release": {"kind": "target", "position": place.tolist()}, "start": start}
    return PlanningJob(None, 0.0, source, request, nearby=left)


def measured(number: int, seed: int) -> dict[str, Any]:
    """Returns what became of a retarget, without the running throw and with it."""
    job = job_of(number, seed)
    assert job.nearby is not None
    left_s = job.nearby.release_time_s
    return {
        "number": number,
        "left_s": left_s,
        "anew": _answered(replace(job, nearby=None)),
        "moved": _answered(job),
    }


def _answered(job: PlanningJob) -> dict[str, Any]:
    begun_s = time.process_time()
    try:
        made = solve(job)
    except PlannerError as refusal:
        return {"taken_s": time.process_time() - begun_s, "release_s": None, "first": str(refusal)}
    taken_s = time.process_time() - begun_s
    attempts = json.loads(made.row.summary)["solver"]["attempts"]
    return {"taken_s": taken_s, "release_s": made.release_time_s, "first": attempts[0]["result"]}


def tally(rows: list[dict[str, Any]]) -> str:
    """Returns the result of rows in words."""
    lines = []
    for name in ("anew", "moved"):
        p50, p90, p99 = np.percentile([1e3 * row[name]["taken_s"] for row in rows], [50, 90, 99])
        planned = sum(row[name]["release_s"] is not None for row in rows)
        lines.append(f"{name}: {planned} of {len(rows)} planned, {p50:.0f} ms (p50), {p90:.0f} (p90), {p99:.0f} (p99)")
    moved = sum(row["moved"]["first"] == "moved throw: certified" for row in rows)
    both = [row for row in rows if row["anew"]["release_s"] and row["moved"]["release_s"]]
    ratios = np.array([row["moved"]["release_s"] / row["anew"]["release_s"] for row in both])
    lines.append(
        f"{moved} throws moved; release over that of a search anew {ratios.mean():.3f}, most {ratios.max():.3f}"
    )
    return "\n".join(lines)


def main() -> None:
    """Measures retargets, and prints the result."""
    given = numbered_parser(__doc__, 48, ROWS).parse_args()
    print(tally(measured_rows(given, lambda number: measured(number, given.seed))))


if __name__ == "__main__":
    main()
