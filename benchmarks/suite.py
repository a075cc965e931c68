"""One run of the benchmark: sets by back ends, search for feasible motions, audit, report."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.audit import AuditResult, run_audit
from benchmarks.feasibility_search import SEARCH, find_certified_motion
from benchmarks.problem_sets import ANYWHERE, IMPOSSIBLE_SETS, Task, build
from benchmarks.report import write_report
from benchmarks.results import ResultFile, ResultRow, machine
from benchmarks.runner import Runner, measured, supported
from planner.backends import casadi_nlp

# Problems per set in the quick run; the SDU sets always have 28 and 35.
QUICK_SETS = {
    "pose": 200,
    "point": 200,
    "target": 200,
    "hard": 64,
    "robust": 100,
    "robust-30": 60,
    "pose-anywhere": 200,
    "point-anywhere": 200,
    "target-anywhere": 200,
    "robust-anywhere": 100,
    "robust-30-anywhere": 60,
    "unreachable": 24,
    "too-fast": 24,
    "sdu-near": 28,
    "sdu-far": 35,
}
PAIR_SETS = {"sdu-near-pairs": 2800, "sdu-far-pairs": 2800}


@dataclass(frozen=True)
class BenchmarkOptions:
    """What to run, and where to write.

    Attributes:
        sets: Names of the sets.
        backends: Names of the back ends; empty for all installed ones.
        count: Problems per set; None for each set's own number.
        seed: Seed of the problems.
        audited: Number of plans to audit; 0 for none.
        out: Folder of the report.
        rows: Folder of the raw rows.
        resume: Whether to continue an interrupted run.
        arguments: The command line, quoted in the report.
    """

    sets: tuple[str, ...]
    backends: tuple[str, ...]
    count: int | None
    seed: int
    audited: int
    out: Path
    rows: Path
    resume: bool
    arguments: tuple[str, ...] = ()


def run(options: BenchmarkOptions) -> None:
    """Loads the optimiser, runs the benchmark and writes the report."""
    casadi_nlp.load()
    gc.collect()
    gc.freeze()  # as in the service's planner processes
    about = machine() | {"command": " ".join(["python -m benchmarks", *options.arguments])}
    results = ResultFile(options.rows / "rows.jsonl", options.resume)
    runner = Runner()
    tasks = {
        name: build(name, options.count or {**QUICK_SETS, **PAIR_SETS}[name], options.seed) for name in options.sets
    }
    installed = supported(next(iter(tasks.values()))[0].problem)
    for name, group in tasks.items():
        _run_set(group, _backends(name, installed, options.backends), results, runner)
    for group in tasks.values():
        _search(group, results)
    audit = _audit(options) if options.audited else AuditResult(0, 0, ())
    _log(f"{audit.audited} certified plans audited by other libraries, {len(audit.faulty)} faulty")
    write_report(options.out, about, results.rows, audit)
    _log(f"written: {options.out}/README.md")


def _audit(options: BenchmarkOptions) -> AuditResult:
    return run_audit(
        options.audited, options.seed, processes=2, rows=options.rows / "audit.jsonl", resume=options.resume
    )


def _backends(name: str, installed: tuple[str, ...], wanted: tuple[str, ...]) -> list[str]:
    """Returns the back ends of a set: Ruckig as the reference first, then the wanted ones.

    Impossible problems and pairs go to `auto` alone; sets with random starts to `auto` and Ruckig.
    """
    if name in IMPOSSIBLE_SETS or name in PAIR_SETS:
        return ["auto"]
    chosen = [b for b in installed if not wanted or b in wanted or b == "ruckig"]
    if name.endswith(ANYWHERE):
        chosen = [b for b in chosen if b in ("ruckig", "auto")]
    if name.startswith("robust"):
        chosen = [b for b in chosen if b in ("casadi", "auto")]
    return sorted(chosen, key=lambda b: b != "ruckig")


def _run_set(tasks: list[Task], backends: list[str], results: ResultFile, runner: Runner) -> None:
    for backend in backends:
        for task in tasks:
            if not results.has(task.name, backend):
                results.add(runner.run(task, backend)[0])
        own = [r for r in results.rows if r.backend == backend and r.group == tasks[0].group]
        _log(f"{tasks[0].group:18} {backend:10} {sum(r.certified for r in own)} of {len(own)} certified")


def _search(tasks: list[Task], results: ResultFile) -> None:
    """Searches for a motion where no back end found one, so that "feasible" does not depend on them."""
    for task in _unsolved(tasks, results):
        if task.state is None or task.problem.is_robust or results.has(task.name, SEARCH):
            continue
        motion = find_certified_motion(task.problem, task.state)
        row = ResultRow(task.name, SEARCH, "failed" if motion is None else "certified")
        if motion is not None:
            row = measured(replace(task, problem=replace(task.problem, release=task.state)), SEARCH, motion)
        results.add(row)


def _unsolved(tasks: list[Task], results: ResultFile) -> Iterator[Task]:
    certified = {row.task for row in results.rows if row.certified}
    return (task for task in tasks if task.name not in certified)


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
