"""The report of this part: one table of pairs, one of answers beside many seeds'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.consistency.loosened import LOOSENED, TICK_SLACK, TIME_LIMIT_S, Pair, pairs_of, release_time
from benchmarks.consistency.many_seeds import SEEDS, soonest_release
from benchmarks.problem_sets import ANYWHERE, Task, boxed_tasks, build
from benchmarks.results import machine

SETS = tuple(f"{kind}{ANYWHERE}" for kind in ("pose", "point", "target", "robust"))
LATE = 1.01  # [-] an answer's release time over the best; the 90th percentile may not be larger
ALLOWED_LATER = 0.01  # [-] share of the pairs that may be later by more than a tick


def consistency_report(problems: int, searched: int, seed: int = 0) -> str:
    """Measures and returns the report.

    Args:
        problems: problems that are loosened.
        searched: problems of each set that are searched from many seeds; 0 to leave that out.
        seed: of the problems.
    """
    where = machine()
    tasks = boxed_tasks(problems, seed)
    pairs = [pair for task in tasks for pair in pairs_of(task)]
    lines = [
        "# Consistent answers",
        "",
        f"{where['processor']}, commit {where['commit']}. One run of `python -m benchmarks.consistency`, seed {seed}.",
        "",
        f"{len(tasks)} poses, points, targets and robust targets from random starts beside a keep-out box, of which "
        f"{len({pair.task for pair in pairs})} are answered, and again with one limit loosened. Nothing may be "
        f"refused, and {ALLOWED_LATER:.0%} of the pairs be later by more than a tick.",
        "",
        *_pair_table(pairs),
    ]
    if searched:
        lines += [
            "",
            f"The answer's release time over the best known: the answer's own, or that from {SEEDS} random release "
            f"states. At the 90th percentile it may be {LATE}. Release times are rounded up to ticks, of which one is "
            "more than 1 % of a launch under 0.2 s: the last column leaves out those that are late by one tick alone.",
            "",
            *_seed_table([(name, build(name, searched, seed)) for name in SETS], seed),
        ]
    return "\n".join([*lines, ""])


def _pair_table(pairs: Sequence[Pair]) -> list[str]:
    rows = ["| loosened | pairs | refused | later | the latest |", "| --- | --- | --- | --- | --- |"]
    for name in LOOSENED:
        own = [pair for pair in pairs if pair.loosened == name]
        ratios = [pair.loose_s / pair.tight_s for pair in own if pair.loose_s is not None]
        counts = (len(own), sum(pair.loose_s is None for pair in own), sum(pair.is_later for pair in own))
        rows.append(f"| {name} | {counts[0]} | {counts[1]} | {counts[2]} | {max(ratios, default=np.nan):.2f} |")
    later = [f"{p.task}, {p.loosened}: {p.tight_s:.3f} to {p.loose_s:.3f} s" for p in pairs if p.is_later]
    refused = [f"{p.task}, {p.loosened}: refused" for p in pairs if p.loose_s is None]
    return rows + ([""] if later + refused else []) + [f"* {line}" for line in refused + later]


def _seed_table(groups: Sequence[tuple[str, list[Task]]], seed: int) -> list[str]:
    head = "| set | answers | p50 | p90 | largest | over 1 % late | and by more than a tick |"
    rows = [head, "| --- | --- | --- | --- | --- | --- | --- |"]
    for name, tasks in groups:
        found = np.array([times for task in tasks if (times := _own_and_best(task, seed)) is not None])
        if not len(found):
            rows.append(f"| {name} | 0 | | | | |")
            continue
        own_s, best_s, tick_s = found.T
        ratios = own_s / best_s
        p50, p90 = np.quantile(ratios, (0.5, 0.9))
        late = ratios > LATE
        by_ticks = own_s - best_s > (1.0 + TICK_SLACK) * tick_s
        counts = f"{late.sum()} | {(late & by_ticks).sum()}"
        rows.append(f"| {name} | {len(ratios)} | {p50:.3f} | {p90:.3f} | {ratios.max():.3f} | {counts} |")
    return rows


def _own_and_best(task: Task, seed: int) -> tuple[float, float, float] | None:
    """Returns the answer's release time, the best known and one tick [s]; None where the task is refused."""
    problem = replace(task.problem, time_limit_s=TIME_LIMIT_S)
    own_s = release_time(problem)
    return None if own_s is None else (own_s, min(own_s, soonest_release(problem, seed)), problem.dt)
