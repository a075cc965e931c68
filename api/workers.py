"""The planner processes: a bounded line in front of a few warm workers, rebuilt when one dies.

The event loop never solves: a request waits here without holding a thread, and `/healthz` answers meanwhile.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any

from api import solving
from api.errors import Problem
from api.solving import Job, Planned, Refused

GRACE_S = 10.0  # [s] beyond `time_limit_s`: a cold start, the search for the nearest, a busy machine
TYPICAL_S = 0.5  # [s] a usual plan; only for the advice in Retry-After
TRIES = 2  # a job whose worker was killed under it is given one more


class Workers:
    """A line in front of `count` planner processes; more than `queue` waiting are turned away.

    A job that takes longer than its time limit and `grace_s` has its process ended.
    """

    def __init__(
        self,
        count: int,
        queue: int,
        warm_up: Job | None = None,
        solve: Callable[[Any], Any] = solving.solve,
        grace_s: float = GRACE_S,
    ) -> None:
        self._count, self._bound = count, count + queue
        self._warm_up, self._solve, self._grace_s = warm_up, solve, grace_s
        self._seats = asyncio.Semaphore(count)
        self._pool: ProcessPoolExecutor | None = None
        self._present = 0
        self.is_warm = False

    async def warm(self) -> None:
        """Starts the processes and waits until one has planned."""
        loop = asyncio.get_running_loop()
        await asyncio.gather(*(loop.run_in_executor(self._open(), _nothing) for _ in range(self._count)))
        self.is_warm = True

    async def solve(self, job: Job, time_limit_s: float) -> Planned | Refused:
        """Plans one request.

        Raises:
            Problem: the line is full; or the worker died or did not come back in time.
        """
        if self._present >= self._bound:
            retry = max(1, math.ceil(self._present * TYPICAL_S / self._count))
            raise Problem("overloaded", "the planning queue is full", headers={"Retry-After": str(retry)})
        self._present += 1
        try:
            async with self._seats:
                return await self._solve_surely(job, time_limit_s + self._grace_s)
        finally:
            self._present -= 1

    @property
    def waiting(self) -> int:
        """How many requests are being planned or wait for it."""
        return self._present

    def close(self) -> None:
        """Ends the processes."""
        if self._pool is not None:
            _end(self._pool)
            self._pool = None

    async def _solve_surely(self, job: Job, patience_s: float) -> Planned | Refused:
        for _ in range(TRIES):
            pool = self._open()
            try:
                future = asyncio.wrap_future(pool.submit(self._solve, job))
                return await asyncio.wait_for(future, patience_s)
            except BrokenProcessPool:
                self._discard(pool)
            except TimeoutError:
                self._discard(pool)
                raise _failed(f"no answer within {patience_s:g} s; the planner process was ended") from None
        raise _failed("the planner process died")

    def _open(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = get_context("spawn")
            self._pool = ProcessPoolExecutor(self._count, context, solving.start, (self._warm_up,))
        return self._pool

    def _discard(self, pool: ProcessPoolExecutor) -> None:
        if pool is self._pool:
            self._pool = None
        _end(pool)


def _nothing() -> None:
    """A job that only shows that a worker has started."""


def _failed(status: str) -> Problem:
    return Problem("solver-failed", status, solver_status=status, iterations=0, attempts=[])


def _end(pool: ProcessPoolExecutor) -> None:
    processes = list((pool._processes or {}).values())  # no public way to end a worker that hangs, before 3.14
    for process in processes:
        process.kill()
    pool.shutdown(wait=True, cancel_futures=True)
