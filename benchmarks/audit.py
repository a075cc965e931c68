"""Audits certified plans of the benchmark's own sets: `python -m benchmarks.audit`. Rows are kept on disk.

`fling audit` draws more kinds of cells and requests.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

from audit.judge import find_faults
from benchmarks.problem_sets import ARMS, Task, build, cell, random_cell_tasks, varied_tasks
from benchmarks.results import add_row, kept_rows
from planner.errors import Infeasible, SolverFailed
from planner.planning import plan

GROUPS = ("pose", "point", "target", "robust", "target-anywhere", "robust-anywhere", "varied")
SEED_OFFSET = 1000  # other problems than those of the sets
RUCKIG_EVERY = 4  # one plan in four is Ruckig's, which reaches its limits in another way
TIME_LIMIT_S = 30.0  # [s] of a plan: on a busy machine, too, work limits the search and not the clock
SPARE = 1.04  # [-] problems drawn per audited plan: some are refused
ROWS = Path(__file__).parents[1] / "build" / "benchmarks" / "audit.jsonl"


@dataclass(frozen=True)
class AuditResult:
    """Result of an audit.

    Attributes:
        audited: Number of certified plans that were checked.
        refused: Number of problems without a plan.
        faulty: Name and faults of every plan that is wrong although certified.
    """

    audited: int
    refused: int
    faulty: tuple[tuple[str, str], ...]


def run_audit(
    count: int, seed: int, processes: int = 1, rows: Path = ROWS, resume: bool = False, cells: int = 0
) -> AuditResult:
    """Audits certified plans of random problems.

    Args:
        count: Number of plans; fewer are audited if too many problems are refused.
        seed: Seed of the problems.
        processes: Number of processes.
        rows: File of the rows.
        resume: Whether to continue after the rows that the file has.
        cells: Number of random cells that the problems are spread over; 0 for the problems of the named sets.
    """
    kept_rows(rows, resume)
    jobs = [(count, seed, cells, part, processes, rows) for part in range(processes)]
    if processes == 1:
        _run(*jobs[0])
    else:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            list(pool.map(_run, *zip(*jobs, strict=True)))
    return tally(rows)


def tally(rows: Path) -> AuditResult:
    """Returns the result of the rows so far."""
    found = list(_read(rows))
    audited = [(name, faults) for name, faults in found if faults is not None]
    faulty = tuple((name, "; ".join(faults)) for name, faults in audited if faults)
    return AuditResult(len(audited), len(found) - len(audited), faulty)


def drawn_tasks(count: int, seed: int, cells: int = 0) -> list[Task]:
    """Returns the problems with their back ends; kinds, and arms or `cells` random cells, take turns."""
    if cells > 0:
        drawn = random_cell_tasks(count, cells, seed)
        turns = cells
    else:
        drawn = _named_tasks(count, seed)
        turns = len(GROUPS)
    return [
        _with_back_end(task, "ruckig" if i // turns % RUCKIG_EVERY == 0 else "auto") for i, task in enumerate(drawn)
    ]


def _named_tasks(count: int, seed: int) -> list[Task]:
    share = -(-round(SPARE * count) // len(GROUPS))
    groups = [build(name, share, seed + SEED_OFFSET) for name in GROUPS[:-1]]
    each = -(-share // len(ARMS))
    per_arm = [varied_tasks(cell(arm), rank, each, seed + SEED_OFFSET) for rank, arm in enumerate(ARMS)]
    groups.append([task for row in zip(*per_arm, strict=True) for task in row])
    return [task for row in zip(*(group[:share] for group in groups), strict=True) for task in row]


def _with_back_end(task: Task, backend: str) -> Task:
    if task.problem.is_robust:
        backend = "auto"  # Ruckig's landings vary too much within a release window
    return replace(task, problem=replace(task.problem, backend=backend, time_limit_s=TIME_LIMIT_S))


def _run(count: int, seed: int, cells: int, part: int, of: int, rows: Path) -> None:
    done = {name for name, _ in _read(rows)}
    for task in drawn_tasks(count, seed, cells)[part::of]:
        if task.name not in done:
            add_row(rows, {"task": task.name, "backend": task.problem.backend, "faults": _faults(task)})


def _faults(task: Task) -> list[str] | None:
    """Returns the faults of the task's plan, None without a plan."""
    try:
        motion = plan(task.problem).trajectory
    except (Infeasible, SolverFailed):
        return None
    return [str(fault) for fault in find_faults(task.problem, motion)]


def _read(rows: Path) -> Iterator[tuple[str, list[str] | None]]:
    for row in kept_rows(rows, True):
        yield row["task"], row["faults"]


def main() -> None:
    """Runs the audit and prints its result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--cells", type=int, default=0, help="random cells; without them the named problem sets")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted run")
    given = parser.parse_args()
    found = run_audit(given.count, given.seed, given.processes, given.rows, given.resume, given.cells)
    print(f"{found.audited} certified plans audited, {found.refused} refused, {len(found.faulty)} faulty")
    for name, fault in found.faulty:
        print(f"{name}: {fault}")


if __name__ == "__main__":
    main()
