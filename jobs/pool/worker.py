"""What a planner process does, what it answers, and what the pool knows of it."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

from jobs.planning import PlanningJob, PlanRecord, refusal_of, solve
from planner.cell import CellSource
from planner.errors import PlannerError, SolverFailed
from planner.progress import Observer, Progress

NICENESS = 5  # the stream to the arm comes first; more would starve planning until its time limit (docs/decisions/0023)
CANCELLED = "cancelled"  # status of a job that was ended as nobody waits for its answer
BATCH_NICENESS = 15  # a batch gives way to single plans


class PoolBroken(Exception):
    """No planner process can be started; the message says why, as far as it is known."""


class JobCancelled(Exception):
    """Nobody waits for the answer to a job any more. No `PlannerError`: nobody takes it for a refusal."""


class PlannerBug(SolverFailed):
    """A planner process ended by an exception that nobody caught: a bug, which would happen again."""


@dataclass(frozen=True)
class JobResult:
    """The result of one job: a plan, or the error of the planner.

    Attributes:
        planned: the plan.
        error: why there is none.
        duration_s: what the worker took for it [s].
        number: of the job in `plan_all`, counted from 0 in the order in which the jobs were given.
    """

    planned: PlanRecord | None
    error: PlannerError | None
    duration_s: float = 0.0
    number: int = 0

    @property
    def refusal(self) -> Mapping[str, Any] | None:
        """The error as a record that can be stored."""
        return None if self.error is None else refusal_of(self.error)


def load_planner(warm_up: PlanningJob | None) -> None:
    """Loads everything that a plan needs: by planning, so that nothing is forgotten."""
    if warm_up is not None:
        with suppress(PlannerError):  # a refused warm-up has loaded everything up to there
            solve(warm_up)
    gc.collect()
    gc.freeze()  # collections during a plan skip everything loaded so far: saves milliseconds


def warm_up_job(source: CellSource) -> PlanningJob:
    """Returns a job that loads and builds everything, as any throw does; its plan is not stored."""
    return PlanningJob(None, 0.0, source, {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}})


@dataclass(frozen=True)
class Work:
    """What a worker does, which tests replace.

    Attributes:
        load: called once, with the job that warms the worker up.
        solve: called for each job, with the observer of its progress.
        warm_up: that job; None: there is none.
        niceness: priority of the worker below that of its pool's process.
    """

    load: Callable[[PlanningJob | None], None] = load_planner
    solve: Callable[[PlanningJob, Observer | None], PlanRecord] = solve
    warm_up: PlanningJob | None = None
    niceness: int = NICENESS

    def begin(self) -> None:
        """Prepares the process of a worker."""
        os.nice(self.niceness)
        self.load(self.warm_up)

    def answer(self, job: PlanningJob, observer: Observer | None = None) -> JobResult:
        """Returns the result of one job, in the process of a worker.

        Args:
            job: to be planned.
            observer: told of the progress; it may raise `JobCancelled`.
        """
        began = time.perf_counter()
        try:
            planned = self.solve(job, observer)
        except JobCancelled:
            return JobResult(None, SolverFailed(CANCELLED), time.perf_counter() - began)
        except PlannerError as error:
            return JobResult(None, error, time.perf_counter() - began)
        return JobResult(planned, None, time.perf_counter() - began)


PLANNING = Work()


@dataclass(frozen=True)
class Report:
    """What an engine reports of a worker: that it is ready, progress or result of its job, or that it has died.

    Attributes:
        worker: its number.
        progress: of its job.
        result: of its job.
        death: why it died, in words.
        is_bug: whether it died of an exception that nobody caught.
    """

    worker: int
    progress: Progress | None = None
    result: JobResult | None = None
    death: str | None = None
    is_bug: bool = False


class Engine(Protocol):
    """Workers, numbered from 0, with one job each. They report when they have started, and after each job."""

    count: int

    def give(self, worker: int, job: PlanningJob) -> None:
        """Gives a job to a worker that has none."""
        ...

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report, or for `wake`."""
        ...

    def wake(self) -> None:
        """Ends a call of `reports` in another thread."""
        ...

    def cancel(self, worker: int) -> None:
        """Asks a worker to end its job, which it reports soon, where it can: as the result, whatever that is."""
        ...

    def replace(self, worker: int) -> None:
        """Ends a worker, dead or alive, and starts another in its place."""
        ...

    def close(self) -> None:
        """Ends all workers."""
        ...
