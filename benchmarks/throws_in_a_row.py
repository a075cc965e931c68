"""Throws in a row without a person: does every plan end where Fling itself can leave? Planning alone, no simulator.

    python -m benchmarks.throws_in_a_row [--throws 100] [--seed 0] [--from-ends] [--window 0.02]

For each of the simulated cells: plan a throw to a random target that some joint state can hit, take the arm to the
plan's end, find the approach to the next start as the executor does (from a measured posture, with an object in the
tool), and go on. By default every throw starts at home; with `--from-ends` it starts where the one before ended. A
target that is refused for another reason than the way home is counted and left out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets import ARMS, Task, build
from planner.approach import find_approach, obstacle_words
from planner.cell import Cell
from planner.errors import Infeasible, SolverFailed
from planner.planning import Plan, plan
from planner.problem import ThrowProblem

Vector = NDArray[np.float64]

MEASURED_RAD = 1e-4  # [rad] standard deviation of a joint's measured position from the plan's end
TOLERANCE_M = 0.01  # [m] of a throw with a release window


def run(tasks: Sequence[Task], from_ends: bool, rng: np.random.Generator) -> tuple[Counter[str], list[float]]:
    """Returns how often each result came of throws in a row, and how long each search for an approach took [s]."""
    now = tasks[0].problem.cell.home
    results = Counter[str]()
    times = []
    for task in tasks:
        problem = replace(task.problem, start=now if from_ends else task.problem.start)
        answer = _answer(problem)
        if isinstance(answer, str):
            results[answer] += 1
            now = problem.cell.home
            continue
        now = answer.trajectory.q[-1]
        begun_s = time.perf_counter()
        reason = _stuck(problem.cell, now + rng.normal(0.0, MEASURED_RAD, 6))
        times.append(time.perf_counter() - begun_s)
        results[f"stuck: {reason}" if reason else "thrown"] += 1
    return results, times


def _answer(problem: ThrowProblem) -> Plan | str:
    """Returns the plan, or the kind of refusal."""
    try:
        return plan(problem)
    except Infeasible as refusal:
        return "refused: " + ", ".join(violation.constraint for violation in refusal.violations)
    except SolverFailed as refusal:
        return f"failed: {refusal}"


def _stuck(cell: Cell, now: Vector) -> str:
    """Returns why no approach leads home from a measured posture; "" where one does, with an object or without."""
    for with_object in (True, False):
        approach, failures = find_approach(cell, now, cell.home, with_object=with_object)
        if approach is not None:
            return "" if with_object else "with an object in the tool alone"
    return obstacle_words(failures)


def main(argv: Sequence[str]) -> int:
    """Runs the throws and prints a line for each cell; returns 1 where a way home was missing."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.throws_in_a_row", description=__doc__)
    parser.add_argument("--throws", type=int, default=100, help="for each cell")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--window", type=float, default=0.0, help="release window [s]")
    parser.add_argument("--from-ends", action="store_true", help="start each throw where the one before ended")
    given = parser.parse_args(argv)
    tasks = build("target", given.throws * len(ARMS), given.seed)
    missing = 0
    for arm in ARMS:
        own = [task for task in tasks if task.problem.cell.name == arm]
        if given.window:
            changes = {"release_window_s": given.window, "landing_tolerance_m": TOLERANCE_M}
            own = [replace(task, problem=replace(task.problem, **changes)) for task in own]
        results, times = run(own, given.from_ends, np.random.default_rng(given.seed))
        missing += sum(count for name, count in results.items() if "way_home" in name or name.startswith("stuck"))
        print(f"{arm:10} {dict(results)}; approach p50 {1e3 * median(times):.1f} ms, max {1e3 * max(times):.0f} ms")
    return int(missing > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
