"""How many certified plans `fling verify` proves, in what time, and whether it accepts one that breaks a limit.

`python -m benchmarks.proofs --count 2000 [--cells 50] [--resume]`. Plans are those of `benchmarks.mutations`, of all
arms and kinds of release in cells with every limit, and those of the audit's problems, in turns. Of the first every
limit is drawn inside what the plan needs: a thousandth of its peak, or a millimetre. The verifier has to refuse each.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.audit import drawn_tasks
from benchmarks.mutations import certified_plans, mutations
from benchmarks.results import add_row, kept_rows
from planner.cell import Cell
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.passages import passed_documents
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import request_document
from planner.trajectory import Trajectory
from verifier import Status, findings

INSIDE = 1e-3  # [-] of a peak, or [m, rad], by which a limit is drawn inside it
ROWS = Path(__file__).parents[1] / "build" / "benchmarks" / "proofs.jsonl"


def document_of(problem: ThrowProblem, trajectory: Trajectory) -> tuple[dict[str, Any], Cell]:
    """Returns what a plan's document says of a motion, and the cell, whose limits are the problem's."""
    cell = replace(problem.cell, limits=problem.limits)
    document = {
        "cell": cell.name,
        "cell_sha256": cell.sha256,
        "request": request_document(problem, problem.release),
        "sample_rate_hz": trajectory.sample_rate_hz,
        "release": {"index": trajectory.release_index} if problem.throws or not problem.passages else None,
        "passages": passed_documents(problem.cell, problem.passages, trajectory) if problem.passages else [],
        "trajectory": {
            "positions": trajectory.q.tolist(),
            "velocities": trajectory.qd.tolist(),
            "accelerations": trajectory.qdd.tolist(),
        },
    }
    return document, cell


def is_accepted(problem: ThrowProblem, trajectory: Trajectory) -> bool:
    """Returns whether the verifier proves a motion for a problem: it stops at the first check that is not proven."""
    return all(each.status is Status.PROVEN for each in findings(*document_of(problem, trajectory)))


def _plans(count: int, seed: int, cells: int) -> Iterator[tuple[str, ThrowProblem, Trajectory, bool]]:
    """Yields plans by their names, and whether their limits are drawn in: those of cells with every limit."""
    own = ((name, problem, motion, True) for name, problem, motion in certified_plans(count, seed))
    audited = _audited(count, seed, cells)
    for both in zip_longest(own, audited):
        yield from (each for each in both if each is not None)


def _audited(count: int, seed: int, cells: int) -> Iterator[tuple[str, ThrowProblem, Trajectory, bool]]:
    for task in drawn_tasks(count, seed, cells):
        try:
            yield task.name, task.problem, plan(task.problem).trajectory, False
        except (Infeasible, SolverFailed):
            continue


def row_of(name: str, problem: ThrowProblem, trajectory: Trajectory, has_mutants: bool) -> dict[str, Any]:
    """Returns what was found of a plan: checks that are not proven, processor time [s], limits tried and accepted."""
    document, cell = document_of(problem, trajectory)
    begin = time.process_time()
    found = list(findings(document, cell))
    seconds = time.process_time() - begin
    tried = 0
    accepted = []
    for mutant in mutations(problem, trajectory, INSIDE) if has_mutants else ():
        tried += 1
        try:
            if is_accepted(mutant.problem(), trajectory):
                accepted.append(mutant.limit)
        except InvalidProblem:
            continue
    return {
        "task": name,
        "open": [str(each) for each in found if each.status is not Status.PROVEN],
        "seconds": seconds,
        "mutants": tried,
        "accepted": accepted,
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """Returns the result in lines."""
    seconds = np.array([row["seconds"] for row in rows])
    proven = [row for row in rows if not row["open"]]
    quick = sum(row["seconds"] <= 1.0 for row in proven)
    opened = Counter(chain.from_iterable({text.split(" at ")[0] for text in row["open"]} for row in rows))
    mutants = sum(row["mutants"] for row in rows if not row["open"])
    accepted = [f"{row['task']}: {limit}" for row in rows for limit in row["accepted"]]
    return "\n".join(
        [
            f"{len(proven)} of {len(rows)} certified plans proven ({quick} within 1 s of one core)",
            f"processor time p50 {np.quantile(seconds, 0.5):.3f} s, p99 {np.quantile(seconds, 0.99):.3f} s",
            f"{mutants} limits of proven plans drawn in, {len(accepted)} accepted all the same",
            *accepted,
            *(f"{count} x {text}" for text, count in opened.most_common()),
        ]
    )


def main() -> None:
    """Verifies plans and their mutants, and prints what was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proofs", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="plans")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, default=0, help="random cells of the audit's problems; 0: the named sets")
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--resume", action="store_true", help="continue an interrupted run")
    parser.add_argument("--tell", action="store_true", help="say what the rows so far say")
    asked = parser.parse_args()
    done = {row["task"] for row in kept_rows(asked.rows, asked.resume or asked.tell)}
    for each in _plans(-(-asked.count // 2), asked.seed, asked.cells) if not asked.tell else ():
        if each[0] not in done:
            add_row(asked.rows, row_of(*each))
    print(summary(kept_rows(asked.rows, True)))


if __name__ == "__main__":
    main()
