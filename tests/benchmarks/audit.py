"""Wrong certificates: random certified plans, judged by other libraries."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from tests.benchmarks.sets import build

GROUPS = ("pose", "point", "target", "robust")
SEED_OFFSET = 1000  # other problems than those of the tables


@dataclass(frozen=True)
class Audit:
    """How many certified plans were judged, and what was wrong with which."""

    judged: int
    refused: int
    wrong: tuple[tuple[str, str], ...]


def audit(count: int, seed: int, backend: str, processes: int = 1) -> Audit:
    """Judges about `count` certified plans of the random sets."""
    share = -(-count // len(GROUPS))
    jobs = [
        (group, share, seed + SEED_OFFSET, backend, part, processes) for group in GROUPS for part in range(processes)
    ]
    if processes == 1:
        parts = [_part(*job) for job in jobs]
    else:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            parts = list(pool.map(_part, *zip(*jobs, strict=True)))
    wrong = tuple(w for part in parts for w in part.wrong)
    return Audit(sum(p.judged for p in parts), sum(p.refused for p in parts), wrong)


def _part(group: str, count: int, seed: int, backend: str, part: int, of: int) -> Audit:
    judged, refused, wrong = 0, 0, []
    for name, faults in _judged(group, count, seed, backend, part, of):
        judged += faults is not None
        refused += faults is None
        if faults:
            wrong.append((name, "; ".join(faults)))
    return Audit(judged, refused, tuple(wrong))


def _judged(
    group: str, count: int, seed: int, backend: str, part: int, of: int
) -> Iterator[tuple[str, list[str] | None]]:
    from tests.benchmarks.judge import wrongs

    for task in build(group, count, seed)[part::of]:
        problem = replace(task.problem, backend=backend)
        try:
            motion = plan(problem).trajectory
        except (Infeasible, SolverFailed):
            yield task.name, None
            continue
        yield task.name, wrongs(problem, motion)
