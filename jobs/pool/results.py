"""The result of one job of many, and how a worker makes it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jobs.planning import Planned, PlanningJob, load, refusal_of, solve
from planner.errors import PlannerError, SolverFailed

Chunk = Sequence[tuple[int, PlanningJob]]  # jobs with their numbers


@dataclass(frozen=True)
class Work:
    """What a worker does: `load` once, with the job that warms it up, and `solve` for each job. Replaced in tests."""

    load: Callable[[PlanningJob | None], None]
    solve: Callable[[PlanningJob], Planned]


PLANNING = Work(load, solve)


@dataclass(frozen=True)
class JobResult:
    """The result of one job: a plan, or the reason why there is none.

    Attributes:
        number: of the job, counted from 0 in the order in which the jobs were given.
        planned: the plan.
        refusal: record of the planner's error, from `jobs.planning.refusal_of`.
        duration_s: what the worker took for it [s].
    """

    number: int
    planned: Planned | None
    refusal: Mapping[str, Any] | None
    duration_s: float = 0.0


def answer(number: int, job: PlanningJob, work: Work) -> JobResult:
    """Returns the result of one job, in the process of a worker."""
    began = time.perf_counter()
    try:
        planned = work.solve(job)
        refusal = None
    except PlannerError as error:
        planned = None
        refusal = refusal_of(error)
    return JobResult(number, planned, refusal, time.perf_counter() - began)


def given_up(number: int, reason: str) -> JobResult:
    """Returns the result of a job that no worker answers."""
    return JobResult(number, None, refusal_of(SolverFailed(reason)))
