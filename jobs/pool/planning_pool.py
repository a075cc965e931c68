"""The pool: gives jobs to the workers of an engine, and yields their results as they are made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from jobs.planning import PlanningJob
from jobs.pool.dispatch import Dispatch
from jobs.pool.results import Chunk, JobResult, given_up
from planner.problem import TIME_LIMIT_S

GRACE_S = 20.0  # [s] beyond a request's time limit: solver calls under way, the search for the nearest, a busy machine
POLL_S = 1.0  # [s] between two looks at who has been at one job for too long
START_FAILURES_MAX = 3  # workers in a row that end before they are ready: none ever will be


class PoolBroken(Exception):
    """No worker can be started; the message says why, as far as it is known."""


@dataclass(frozen=True)
class Report:
    """What an engine reports of a worker: a result; that it is ready for a chunk; or that it has died.

    Attributes:
        worker: its number.
        result: of the job that it had in hand first.
        death: why it died, in words.
    """

    worker: int
    result: JobResult | None = None
    death: str | None = None


class Engine(Protocol):
    """Workers, numbered from 0. Each reports that it is ready when it has started, and after each chunk."""

    count: int

    def give(self, worker: int, chunk: Chunk) -> None:
        """Gives a chunk to a worker that is ready."""
        ...

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report."""
        ...

    def replace(self, worker: int) -> None:
        """Ends a worker, dead or alive, and starts another in its place."""
        ...

    def close(self) -> None:
        """Ends all workers."""
        ...


class PlanningPool:
    """Warm workers that plan jobs; a context manager. One call of `plan_all` at a time.

    Args:
        engine: the workers.
        grace_s: a worker that exceeds the time limit of its job by more than this is replaced [s].

    Attributes:
        workers: their number.
    """

    def __init__(self, engine: Engine, grace_s: float = GRACE_S) -> None:
        self._engine = engine
        self._grace_s = grace_s
        self._ready: set[int] = set()
        self._start_failures = 0
        self.workers = engine.count

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the workers; what they have in hand is lost."""
        self._engine.close()

    def wait_until_ready(self) -> None:
        """Returns once all workers are warm; jobs can be given before.

        Raises:
            PoolBroken: No worker can be started.
        """
        idle = Dispatch((), self.workers)
        while len(self._ready) < self.workers:
            for report in self._engine.reports(POLL_S):
                self._handle(report, idle)

    def plan_all(
        self, jobs: Iterable[PlanningJob], must_stop: Callable[[], bool] = lambda: False
    ) -> Iterator[JobResult]:
        """Yields the result of each job, in the order in which they are made.

        Jobs are read as they are needed. A worker that dies is replaced, and its unanswered jobs are given out again;
        a job over which two workers died, or one that is not answered in time, has a refusal. Whoever stops reading
        stops the planning: what is in hand then is lost.

        Args:
            jobs: what to plan.
            must_stop: asked every second at least; true ends the planning, as if nobody read on.

        Raises:
            PoolBroken: No worker can be started.
        """
        dispatch = Dispatch(jobs, self.workers)
        try:
            while not must_stop():
                self._give_out(dispatch)
                if not dispatch.at_hand() and self._ready:
                    return
                for report in self._engine.reports(POLL_S):
                    result = self._handle(report, dispatch)
                    if result is not None:
                        yield result
                yield from self._overdue(dispatch)
        finally:
            for worker, *_ in dispatch.at_hand():
                self._engine.replace(worker)

    def _give_out(self, dispatch: Dispatch) -> None:
        for worker in sorted(self._ready):
            chunk = dispatch.chunk(worker)
            if not chunk:
                return
            self._ready.remove(worker)
            self._engine.give(worker, chunk)

    def _handle(self, report: Report, dispatch: Dispatch) -> JobResult | None:
        """Notes a report; returns the result that it brings, or causes."""
        if report.result is not None:
            dispatch.answered(report.worker, report.result.number)
            return report.result
        if report.death is None:
            self._start_failures = 0
            self._ready.add(report.worker)
            return None
        return self._bury(report.worker, report.death, dispatch)

    def _bury(self, worker: int, death: str, dispatch: Dispatch) -> JobResult | None:
        """Replaces a dead worker; returns the refusal of the job that it died of, where it is not the first to."""
        had_work = any(worker == busy for busy, *_ in dispatch.at_hand())
        if not had_work and worker not in self._ready:
            self._start_failures += 1
        if self._start_failures >= START_FAILURES_MAX:
            raise PoolBroken(f"{self._start_failures} planner processes ended before they were ready: {death}")
        self._ready.discard(worker)
        self._engine.replace(worker)
        number = dispatch.died(worker)
        if number is None:
            return None
        return given_up(number, f"the planner process died twice over this request: {death}")

    def _overdue(self, dispatch: Dispatch) -> Iterator[JobResult]:
        """Replaces the workers that are at one job for too long; yields the refusals of these jobs."""
        for worker, number, job, duration_s in dispatch.at_hand():
            limit_s = float(job.request.get("time_limit_s") or TIME_LIMIT_S) + self._grace_s
            if duration_s > limit_s:
                dispatch.abandoned(worker)
                self._engine.replace(worker)
                yield given_up(number, f"no answer within {limit_s:g} s; the planner process was ended")
