"""Wrong certificates: random certified plans, judged by other libraries. Rows on disk, so a run can be continued.

`python -m tests.benchmarks.audit --count 10000` runs it alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from tests.benchmarks.sets import ARMS, build, cell
from tests.benchmarks.task import Task
from tests.benchmarks.variants import varied_tasks

GROUPS = ("pose", "point", "target", "robust", "target-anywhere", "robust-anywhere", "varied")
SEED_OFFSET = 1000  # other problems than those of the tables
EVERY = 4  # one plan in so many is by `ruckig`, whose motions run along their limits in another way
SPARE = 1.04  # [-] problems drawn for each plan to be judged: some are refused
ROWS = Path(__file__).parents[2] / "build" / "benchmarks" / "audit.jsonl"


@dataclass(frozen=True)
class Audit:
    """How many certified plans were judged, and what was wrong with which."""

    judged: int
    refused: int
    wrong: tuple[tuple[str, str], ...]


def audit(count: int, seed: int, processes: int = 1, rows: Path = ROWS, resume: bool = False) -> Audit:
    """Judges at least `count` certified plans of random problems, fewer where too many were refused."""
    rows.parent.mkdir(parents=True, exist_ok=True)
    if not resume:
        rows.unlink(missing_ok=True)
    jobs = [(count, seed, part, processes, rows) for part in range(processes)]
    if processes == 1:
        _run(*jobs[0])
    else:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            list(pool.map(_run, *zip(*jobs, strict=True)))
    return tally(rows)


def tally(rows: Path) -> Audit:
    """Returns what the rows say so far."""
    found = list(_read(rows))
    judged = [(name, faults) for name, faults in found if faults is not None]
    wrong = tuple((name, "; ".join(faults)) for name, faults in judged if faults)
    return Audit(len(judged), len(found) - len(judged), wrong)


def drawn(count: int, seed: int) -> list[Task]:
    """Returns the problems, kinds and arms in turn, the back end of each written into it."""
    share = -(-round(SPARE * count) // len(GROUPS))
    groups = [build(name, share, seed + SEED_OFFSET) for name in GROUPS[:-1]]
    each = -(-share // len(ARMS))
    per_arm = [varied_tasks(cell(arm), rank, each, seed + SEED_OFFSET) for rank, arm in enumerate(ARMS)]
    groups.append([task for row in zip(*per_arm, strict=True) for task in row])
    tasks = [task for row in zip(*(group[:share] for group in groups), strict=True) for task in row]
    return [_with_back_end(task, "ruckig" if i // len(GROUPS) % EVERY == 0 else "auto") for i, task in enumerate(tasks)]


def _with_back_end(task: Task, backend: str) -> Task:
    if task.problem.is_robust:
        backend = "auto"  # Ruckig's landings scatter too much to be certified
    return replace(task, problem=replace(task.problem, backend=backend))


def _run(count: int, seed: int, part: int, of: int, rows: Path) -> None:
    done = {name for name, _ in _read(rows)}
    for task in drawn(count, seed)[part::of]:
        if task.name not in done:
            line = json.dumps({"task": task.name, "backend": task.problem.backend, "faults": _faults(task)})
            with rows.open("a", encoding="utf-8") as file:
                file.write(line + "\n")


def _faults(task: Task) -> list[str] | None:
    """Returns what is wrong with the plan, None where there is no plan."""
    from tests.benchmarks.judge import wrongs

    try:
        motion = plan(task.problem).trajectory
    except (Infeasible, SolverFailed):
        return None
    return wrongs(task.problem, motion)


def _read(rows: Path) -> Iterator[tuple[str, list[str] | None]]:
    lines = rows.read_text(encoding="utf-8").splitlines() if rows.exists() else []
    for line in lines:
        row = json.loads(line)
        yield row["task"], row["faults"]


def main() -> None:
    """Judges, and prints what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--resume", action="store_true", help="go on with a run that was broken off")
    given = parser.parse_args()
    found = audit(given.count, given.seed, given.processes, given.rows, given.resume)
    print(f"{found.judged} certified plans judged, {found.refused} refused, {len(found.wrong)} wrong")
    for name, fault in found.wrong:
        print(f"{name}: {fault}")


if __name__ == "__main__":
    main()
