"""The pool: one line of jobs in front of the workers of an engine, in the order in which they are submitted."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from itertools import islice
from types import TracebackType
from typing import Self

from jobs.planning import PlanningJob
from jobs.pool.local_engine import LocalEngine
from jobs.pool.ray_engine import RayEngine
from jobs.pool.worker import CANCELLED, PLANNING, Engine, JobResult, PlannerBug, PoolBroken, Report, Work
from planner.errors import PlannerError, SolverFailed
from planner.progress import Observer

GRACE_S = 20.0  # [s] beyond a request's time limit: solver calls under way, the search for the nearest, a busy machine
CANCEL_S = 5.0  # [s] after which a worker that was asked to end its job is replaced: to load another takes as long
CANCEL_POLL_S = 0.1  # [s] between two looks at whether it has ended
POLL_S = 1.0  # [s] between two looks at who has been at one job for too long
START_FAILURES_MAX = 3  # workers in a row that end before they are ready: none ever will be
TRIES = 2  # a job whose worker died over it is tried once more
AHEAD = 2  # jobs a worker that `plan_all` submits ahead, so that no worker waits for the next one


@dataclass(eq=False)
class _Task:
    """A submitted job, its answer to be, and what became of it so far.

    Attributes:
        job: that was submitted.
        observer: told of its progress.
        future: what becomes its result.
        deaths: workers that died over it.
        limit_s: time that a worker may take [s].
        ends_at: when its worker is replaced, on the monotonic clock [s].
        is_cancelled: whether its worker was asked to end it.
    """

    job: PlanningJob
    observer: Observer | None = None
    future: Future[JobResult] = field(default_factory=Future)
    deaths: int = 0
    limit_s: float = 0.0
    ends_at: float = 0.0
    is_cancelled: bool = False


def open_pool(
    workers: int | None = None,
    ray_address: str | None = None,
    work: Work = PLANNING,
    grace_s: float = GRACE_S,
    most: int | None = None,
) -> PlannerPool:
    """Opens a pool. Its workers start at once; they are warm some seconds later, and jobs can be given before.

    Args:
        workers: Number of workers; None: one a core of this machine, or of the cluster.
        ray_address: Address of a Ray cluster; None: processes of this machine.
        work: What a worker does.
        grace_s: A worker that exceeds the time limit of its job by more than this is replaced [s].
        most: Greatest number of workers on this machine, or of those that were asked for; None: any.

    Raises:
        PoolBroken: Ray is not installed, or there is no cluster at this address.
    """
    if ray_address is None and workers is None:
        workers = os.cpu_count() or 1
    if workers is not None and most is not None:
        workers = min(workers, most)
    engine = LocalEngine(workers or 1, work) if ray_address is None else RayEngine(ray_address, workers, work)
    return PlannerPool(engine, grace_s)


class PlannerPool:
    """Warm workers that plan jobs for any thread; a context manager.

    A worker that dies is replaced, and its job is tried once more; one that exceeds its time limit is replaced too. The
    workers belong to a thread of the pool's own.

    Args:
        engine: the workers.
        grace_s: a worker that exceeds the time limit of its job by more than this is replaced [s].

    Attributes:
        workers: their number.
        is_warm: whether all of them were ready once.
    """

    def __init__(self, engine: Engine, grace_s: float = GRACE_S) -> None:
        self._engine = engine
        self._grace_s = grace_s
        self._line: deque[_Task] = deque()
        self._in_hand: dict[int, _Task] = {}
        self._unwanted: deque[Future[JobResult]] = deque()
        self._ready: set[int] = set()
        self._dead: set[int] = set()
        self._start_failures = 0
        self._warmed: set[int] = set()
        self._changed = threading.Condition()
        self._is_closed = False
        self._has_ended = False
        self.workers = engine.count
        self._thread = threading.Thread(target=self._run, name="planner pool", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_warm(self) -> bool:
        """Whether all workers were ready once."""
        return len(self._warmed) == self.workers

    def close(self) -> None:
        """Ends the workers; what they have in hand is lost."""
        self._is_closed = True
        self._engine.wake()
        self._thread.join()
        self._engine.close()

    def submit(self, job: PlanningJob, observer: Observer | None = None) -> Future[JobResult]:
        """Puts a job in line; returns what becomes its result.

        Args:
            job: to be planned.
            observer: told of the progress of a job with `tells_progress`, in the thread of the pool; must not raise.

        A future that is cancelled while its job is in line leaves the line. It has the exception `PoolBroken` if no
        worker can be started.
        """
        task = _Task(job, observer)
        self._line.append(task)
        self._engine.wake()
        if self._has_ended:
            self._abandon()
        return task.future

    def cancel(self, future: Future[JobResult]) -> None:
        """Ends the job of a future, in line or in hand; nothing happens where it has been answered.

        A worker ends its search at the next step; one that has not within `CANCEL_S` is replaced.
        """
        if not future.done() and not future.cancel():
            self._unwanted.append(future)
            self._engine.wake()

    def wait_until_warm(self) -> None:
        """Returns once all workers are warm; jobs can be given before.

        Raises:
            PoolBroken: No worker can be started.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.is_warm or self._cannot_start or self._has_ended)
        if not self.is_warm:
            raise PoolBroken("no planner process can be started")

    def plan_all(
        self, jobs: Iterable[PlanningJob], must_stop: Callable[[], bool] = lambda: False
    ) -> Iterator[JobResult]:
        """Yields the result of each job, in the order in which they are made.

        Jobs are read as they are needed. If reading stops, the jobs in line are cancelled,
        and the results of those in hand are dropped.

        Args:
            jobs: what to plan.
            must_stop: asked every second at least; true ends the planning.

        Raises:
            PoolBroken: No worker can be started.
        """
        remaining = enumerate(jobs)
        made: queue.SimpleQueue[Future[JobResult]] = queue.SimpleQueue()
        numbers: dict[Future[JobResult], int] = {}
        try:
            while not must_stop():
                for number, job in islice(remaining, (AHEAD + 1) * self.workers - len(numbers)):
                    future = self.submit(job)
                    numbers[future] = number
                    future.add_done_callback(made.put)
                if not numbers:
                    return
                try:
                    future = made.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                yield replace(future.result(), number=numbers.pop(future))
        finally:
            for future in numbers:
                future.cancel()

    @property
    def _cannot_start(self) -> bool:
        return self._start_failures >= START_FAILURES_MAX

    def _run(self) -> None:
        try:
            while not self._is_closed:
                self._raise_the_dead()
                self._give_out()
                is_ending = any(task.is_cancelled for task in self._in_hand.values())
                for report in self._engine.reports(CANCEL_POLL_S if is_ending else POLL_S):
                    self._handle(report)
                self._cancel_unwanted()
                self._end_overdue()
        finally:  # of an error, too: nobody waits for an answer then
            self._has_ended = True
            self._abandon()

    def _abandon(self) -> None:
        """Cancels what is in line, and fails what is in hand."""
        for task in (*self._in_hand.values(), *self._line):
            if not task.future.cancel() and not task.future.done():
                task.future.set_exception(PoolBroken("the pool has ended"))
        with self._changed:
            self._changed.notify_all()

    def _raise_the_dead(self) -> None:
        """Starts workers in place of those that died; if none can be started, only once there is a new job."""
        if self._cannot_start:
            if not self._line:
                return
            self._start_failures = 0
        for worker in self._dead:
            self._engine.replace(worker)
        self._dead.clear()

    def _give_out(self) -> None:
        while self._ready and self._line:
            task = self._line.popleft()
            if not task.deaths and not task.future.set_running_or_notify_cancel():
                continue
            worker = self._ready.pop()
            self._in_hand[worker] = task
            task.limit_s = task.job.time_limit_s + self._grace_s
            task.ends_at = time.monotonic() + task.limit_s
            self._engine.give(worker, task.job)

    def _handle(self, report: Report) -> None:
        if report.death is not None:
            self._bury(report)
            return
        if report.progress is not None:
            task = self._in_hand[report.worker]
            if task.observer is not None:
                task.observer(report.progress)
            return
        self._ready.add(report.worker)
        if report.result is not None:
            self._in_hand.pop(report.worker).future.set_result(report.result)
            return
        self._start_failures = 0
        with self._changed:
            self._warmed.add(report.worker)
            self._changed.notify_all()

    def _bury(self, report: Report) -> None:
        """Notes a death: the job is put back in line, or refused where it is not the first worker that died of it."""
        self._dead.add(report.worker)
        task = self._in_hand.pop(report.worker, None)
        if task is not None:
            task.deaths += 1
            if report.is_bug:
                _refuse(task, PlannerBug(f"a bug ended the planner process: {report.death}"))
            elif task.is_cancelled:
                _refuse(task, SolverFailed(CANCELLED))
            elif task.deaths >= TRIES:
                _refuse(task, SolverFailed(f"the planner process died twice over this request: {report.death}"))
            else:
                self._line.appendleft(task)
        elif report.worker not in self._ready:
            self._start_failures += 1
            if self._cannot_start:
                self._give_up(str(report.death))
        self._ready.discard(report.worker)

    def _give_up(self, death: str) -> None:
        """Fails everything in line: no worker can be started."""
        reason = f"{self._start_failures} planner processes ended before they were ready: {death}"
        while self._line:
            task = self._line.popleft()
            if task.deaths or task.future.set_running_or_notify_cancel():
                task.future.set_exception(PoolBroken(reason))
        with self._changed:
            self._changed.notify_all()

    def _cancel_unwanted(self) -> None:
        """Asks the workers whose answers nobody wants any more to end their jobs."""
        while self._unwanted:
            future = self._unwanted.popleft()
            for worker, task in self._in_hand.items():
                if task.future is future:
                    task.is_cancelled = True
                    task.ends_at = min(task.ends_at, time.monotonic() + CANCEL_S)
                    self._engine.cancel(worker)
            for task in [task for task in self._line if task.future is future]:  # again in line: its worker has died
                self._line.remove(task)
                _refuse(task, SolverFailed(CANCELLED))

    def _end_overdue(self) -> None:
        """Replaces the workers that are at one job for too long, and refuses these jobs."""
        now = time.monotonic()
        for worker, task in list(self._in_hand.items()):
            if now > task.ends_at:
                del self._in_hand[worker]
                self._engine.replace(worker)
                late = f"no answer within {task.limit_s:g} s; the planner process was ended"
                _refuse(task, SolverFailed(CANCELLED if task.is_cancelled else late))


def _refuse(task: _Task, error: PlannerError) -> None:
    task.future.set_result(JobResult(None, error))
