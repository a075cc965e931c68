"""The bounded line of requests in front of the planner processes.

The event loop never plans: a request waits here without holding a thread, and `/healthz` answers meanwhile.
"""

from __future__ import annotations

import asyncio
import math
from concurrent.futures import Future
from functools import partial

from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import JobResult, PlannerPool
from planner.progress import Observer

TYPICAL_PLAN_S = 0.5  # [s] duration of a usual plan, for the advice in Retry-After
RETRY_MAX_S = 60  # [s] longest advice: connections are kept for longer
DRAIN_POLL_S = 0.02  # [s] between two looks at whether everything is answered


class PlanningQueueFull(Exception):
    """The planning queue is full; `retry_after_s` is the advised wait [s]."""

    def __init__(self, retry_after_s: int) -> None:
        super().__init__("the planning queue is full")
        self.retry_after_s = retry_after_s


class PlanningEnded(Exception):
    """The service is shutting down, and this request had not been begun."""

    def __init__(self) -> None:
        super().__init__("the service is shutting down; this request waited in line")


class ClientGone(Exception):
    """The client left before its request was answered."""


class PlanningLine:
    """Planner processes behind a bounded line.

    Args:
        pool: the processes.
        queue: Number of requests that may wait for a process; further ones are rejected.
    """

    def __init__(self, pool: PlannerPool, queue: int) -> None:
        self._pool = pool
        self._queue = queue
        self._open: set[Future[JobResult]] = set()
        self._is_draining = False

    @property
    def waiting(self) -> int:
        """Number of requests being planned or queued."""
        return len(self._open)

    @property
    def is_warm(self) -> bool:
        """Whether the processes have planned their warm-up job."""
        return self._pool.is_warm

    async def solve(
        self, job: PlanningJob, gone: asyncio.Event | None = None, observer: Observer | None = None
    ) -> PlanRecord:
        """Plans one request. If the task is cancelled, the search ends.

        Args:
            job: the request.
            gone: set when the client has left: the request leaves the line, or its search ends.
            observer: told of the progress of a job with `tells_progress`, in the event loop.

        Raises:
            ClientGone: The client left.
            PlanningQueueFull: Too many requests wait already.
            PlanningEnded: `drain` was called before this request was begun.
            PlannerError: The planner refused the request, or its process died or did not answer in time.
            PoolBroken: No planner process can be started.
        """
        if self._is_draining:
            raise PlanningEnded
        if self.waiting >= self._pool.workers + self._queue:
            advice = math.ceil(self.waiting * TYPICAL_PLAN_S / self._pool.workers)
            raise PlanningQueueFull(min(max(1, advice), RETRY_MAX_S))
        loop = asyncio.get_running_loop()
        tell = None if observer is None else partial(loop.call_soon_threadsafe, observer)
        future = self._pool.submit(job, tell)
        self._open.add(future)
        try:
            return await self._answer(future, gone or asyncio.Event())
        finally:
            self._pool.cancel(future)
            self._open.discard(future)

    async def drain(self) -> None:
        """Gives up the requests in line; returns once those that were begun are answered, each in its own time."""
        self._is_draining = True
        for future in self._open:
            future.cancel()
        while self._open:
            await asyncio.sleep(DRAIN_POLL_S)

    def close(self) -> None:
        """Ends the processes."""
        self._pool.close()

    async def _answer(self, future: Future[JobResult], gone: asyncio.Event) -> PlanRecord:
        answer = asyncio.wrap_future(future)
        left = asyncio.ensure_future(gone.wait())
        try:
            await asyncio.wait((answer, left), return_when=asyncio.FIRST_COMPLETED)
            if not answer.done():
                raise ClientGone
        finally:
            left.cancel()
        if answer.cancelled():
            raise PlanningEnded
        result = answer.result()
        if result.planned is None:
            assert result.error is not None  # a result has one of the two
            raise result.error
        return result.planned
