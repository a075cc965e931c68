"""The pool of planner processes: a bounded queue in front of a few warm workers, rebuilt when one dies.

The event loop never plans: a request waits here without holding a thread, and `/healthz` answers meanwhile.
"""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any

from batch.jobs import Planned, PlanningJob, initialise, solve
from planner.errors import SolverFailed

GRACE_S = 20.0  # [s] beyond `time_limit_s`: solver calls under way, the search for the nearest request, a busy machine
TYPICAL_PLAN_S = 0.5  # [s] duration of a usual plan, for the advice in Retry-After
RETRY_MAX_S = 60  # [s] longest advice: connections are kept for longer
DRAIN_POLL_S = 0.02  # [s] between two looks at whether everything is answered
TRIES = 2  # a job whose worker was killed is tried once more


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
    """The client left before its request was begun."""


@dataclass(frozen=True)
class WorkerFunctions:
    """What a planner process runs: `initialise` at its start, with the warm-up job, then `solve` for each job."""

    solve: Callable[[Any], Any] = solve
    initialise: Callable[[Any], object] = initialise


class PlannerPool:
    """Planner processes behind a bounded queue.

    Args:
        count: Number of processes.
        queue: Number of requests that may wait for a process; further ones are rejected.
        warm_up: Planned by each process when it starts.
        functions: What a process runs; replaced in tests.
        grace_s: A process that exceeds the time limit of its job by more than this is killed [s].

    Attributes:
        waiting: Number of requests being planned or queued.
        is_warm: Whether the processes have planned their warm-up job.
    """

    def __init__(
        self,
        count: int,
        queue: int,
        warm_up: PlanningJob | None = None,
        functions: WorkerFunctions | None = None,
        grace_s: float = GRACE_S,
    ) -> None:
        self._count = count
        self._capacity = count + queue
        self._warm_up_job, self._grace_s, self._functions = warm_up, grace_s, functions or WorkerFunctions()
        self._free = asyncio.Semaphore(count)
        self._executor: ProcessPoolExecutor | None = None
        self._starting = asyncio.Lock()
        self.waiting = 0
        self.is_warm = False
        self._is_draining = False

    async def warm_up(self) -> None:
        """Starts the processes and waits until they have planned their warm-up job."""
        await self._ready()

    async def solve(self, job: PlanningJob, time_limit_s: float, gone: asyncio.Event | None = None) -> Planned:
        """Plans one request.

        Args:
            job: the request.
            time_limit_s: of its search [s].
            gone: set when the client has left: a request in line is given up. One that was begun ends by its own limit:
                to kill its process would cost seconds of loading, more than most plans take.

        Raises:
            ClientGone: The client left while the request was in line.
            PlanningQueueFull: Too many requests wait already.
            PlanningEnded: `drain` was called before this request was begun.
            PlannerError: The planner refused the request, or its process died or did not answer in time.
        """
        if self.waiting >= self._capacity:
            advice = math.ceil(self.waiting * TYPICAL_PLAN_S / self._count)
            raise PlanningQueueFull(min(max(1, advice), RETRY_MAX_S))
        self.waiting += 1
        try:
            await self._turn(gone or asyncio.Event())
            try:
                if self._is_draining:
                    raise PlanningEnded
                return await self._run(job, time_limit_s + self._grace_s)
            finally:
                self._free.release()
        finally:
            self.waiting -= 1

    async def drain(self) -> None:
        """Gives up the requests in line; returns once those that were begun are answered, each in its own time."""
        self._is_draining = True
        while self.waiting:
            await asyncio.sleep(DRAIN_POLL_S)

    def close(self) -> None:
        """Ends the processes."""
        if self._executor is not None:
            self._discard(self._executor)

    async def _turn(self, gone: asyncio.Event) -> None:
        """Waits until a process is free, and takes it.

        Raises:
            ClientGone: The client left before.
        """
        turn = asyncio.ensure_future(self._free.acquire())
        left = asyncio.ensure_future(gone.wait())
        taken = False
        try:
            await asyncio.wait((turn, left), return_when=asyncio.FIRST_COMPLETED)
            if gone.is_set():
                raise ClientGone
            taken = True
        finally:
            left.cancel()
            if not taken and not turn.cancel():  # it came at the same moment
                self._free.release()

    async def _run(self, job: PlanningJob, timeout_s: float) -> Planned:
        for _ in range(TRIES):
            executor = await self._ready()  # loading takes its time, which is none of the job's
            try:
                future = asyncio.wrap_future(executor.submit(self._functions.solve, job))
                return await asyncio.wait_for(future, timeout_s)
            except BrokenProcessPool:
                self._discard(executor)
            except TimeoutError:
                self._discard(executor)
                raise SolverFailed(f"no answer within {timeout_s:g} s; the planner process was killed") from None
        raise SolverFailed("the planner process died")

    async def _ready(self) -> ProcessPoolExecutor:
        """Returns the processes, loaded; starts them where there are none."""
        async with self._starting:
            return self._executor or await self._use(self._new())

    def _new(self) -> ProcessPoolExecutor:
        context = get_context("spawn")  # never fork: this process has threads
        return ProcessPoolExecutor(self._count, context, self._functions.initialise, (self._warm_up_job,))

    async def _use(self, executor: ProcessPoolExecutor) -> ProcessPoolExecutor:
        """Returns these processes once they are loaded; they are used from now on."""
        loop = asyncio.get_running_loop()
        loaded = False
        try:
            loading = [loop.run_in_executor(executor, os.getpid) for _ in range(self._count)]
            self._watch(executor)
            await asyncio.gather(*loading)
            loaded = True
        finally:
            if not loaded:
                self._discard(executor)
        self._executor = executor
        self.is_warm = True
        return executor

    def _watch(self, executor: ProcessPoolExecutor) -> None:
        """Has all processes replaced as soon as one dies.

        The executor notices that by itself, unless the process was killed within a result, or with a lock of the
        queues: then it waits for ever for the rest.
        """
        loop = asyncio.get_running_loop()
        for process in _processes(executor):
            loop.add_reader(process.sentinel, self._discard, executor)

    def _discard(self, executor: ProcessPoolExecutor) -> None:
        if executor is self._executor:
            self._executor = None
        _unwatch(executor)
        _kill(executor)


def _processes(executor: ProcessPoolExecutor) -> list[BaseProcess]:
    return list((executor._processes or {}).values())  # before Python 3.14 there is no public way to kill a worker


def _unwatch(executor: ProcessPoolExecutor) -> None:
    for process in _processes(executor):
        asyncio.get_running_loop().remove_reader(process.sentinel)


def _kill(executor: ProcessPoolExecutor) -> None:
    """Kills the processes; their jobs end with `BrokenProcessPool`. Returns at once: this is the event loop."""
    for process in _processes(executor):
        process.kill()
    results: Any = executor._result_queue
    if results is not None:
        results._writer.close()  # nobody else has it open now: half a result comes to its end
    executor.shutdown(wait=False, cancel_futures=True)
