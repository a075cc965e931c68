"""The pool of planner processes: bounded, hung workers killed, dead ones replaced. `time.sleep` stands for a solver."""

from __future__ import annotations

import asyncio
import os
import signal
import struct
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import pytest

from api.http import translate
from api.planning import ClientGone, PlannerPool, PlanningEnded, PlanningQueueFull
from api.planning.pool import WorkerFunctions
from planner.errors import SolverFailed

HANGS_S = 200.0  # [s] processes are started anew before, on a busy machine


def run(test: Callable[[PlannerPool], Coroutine[Any, Any, None]], solve: Callable[[Any], Any], **options: Any) -> None:
    async def whole() -> None:
        light = WorkerFunctions(solve, bool)  # nothing is loaded: most of this is about the pool
        functions = WorkerFunctions(solve) if options.pop("whole", False) else light
        pool = PlannerPool(options.pop("count", 1), options.pop("queue", 0), None, functions, **options)
        try:
            await test(pool)
        finally:
            pool.close()

    asyncio.run(whole())


def test_a_full_queue_is_answered_with_a_time_to_retry():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        first = asyncio.create_task(pool.solve(0.5, 60.0))
        await asyncio.sleep(0.05)
        assert pool.waiting == 1
        with pytest.raises(PlanningQueueFull) as caught:
            await pool.solve(0.5, 60.0)
        problem = translate(caught.value)
        assert problem.name == "overloaded"
        assert int(problem.headers["Retry-After"]) >= 1
        await first
        assert pool.waiting == 0

    run(test, time.sleep)


def test_a_client_that_left_gives_up_its_place_in_line():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        gone = asyncio.Event()
        first = asyncio.create_task(pool.solve(0.4, 60.0, gone))
        await asyncio.sleep(0.05)
        second = asyncio.create_task(pool.solve(3600.0, 60.0, gone))
        await asyncio.sleep(0.05)
        assert pool.waiting == 2
        gone.set()
        with pytest.raises(ClientGone):
            await second
        assert pool.waiting == 1
        await first  # it was begun, and ends by itself
        await asyncio.wait_for(pool.solve(0.0, 60.0), 30.0)  # the place is free again
        assert pool.waiting == 0

    run(test, time.sleep, queue=2)


def test_the_loop_is_free_while_a_worker_works():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        solving = asyncio.create_task(pool.solve(0.5, 60.0))
        for _ in range(10):
            await asyncio.sleep(0.01)
            assert not solving.done()
        await solving

    run(test, time.sleep)


def test_a_hung_worker_is_killed_and_the_next_job_is_done():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        with pytest.raises(SolverFailed) as caught:
            await pool.solve(3600.0, 0.1)
        assert translate(caught.value).name == "solver-failed"
        assert await pool.solve(0.0, 60.0) is None

    run(test, time.sleep, grace_s=0.1)


def test_a_job_that_kills_its_worker_is_given_up_and_the_queue_goes_on():
    async def test(pool: PlannerPool) -> None:
        with pytest.raises(SolverFailed) as caught:
            await pool.solve(3, 60.0)
        problem = translate(caught.value)
        assert problem.name == "solver-failed"
        assert "died" in problem.detail
        await pool.warm_up()

    run(test, os._exit)


def test_a_worker_killed_from_outside_costs_nothing_but_time():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        (victim,) = pool._executor._processes.values()
        job = asyncio.create_task(pool.solve(1.0, 60.0))
        await asyncio.sleep(0.2)
        victim.kill()
        assert await job is None

    run(test, time.sleep)


def half_an_answer(seconds: float) -> bytes:
    """Answers; with a negative number its process is killed in the middle of that."""

    def half(connection: Connection, buffer: bytes) -> None:
        os.write(connection.fileno(), struct.pack("!i", len(buffer)) + bytes(buffer[: len(buffer) // 2]))
        os.kill(os.getpid(), signal.SIGKILL)

    if seconds < 0.0:
        Connection._send_bytes = half  # type: ignore[attr-defined]
    time.sleep(abs(seconds))
    return b"whole"


def test_a_worker_killed_within_its_answer_does_not_stop_the_service():
    """The executor's own thread waits for the rest of the answer: another process could still write it."""

    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        long = asyncio.create_task(pool.solve(2.0, 60.0))
        with pytest.raises(SolverFailed, match="died"):
            await pool.solve(-0.2, 60.0)
        assert await asyncio.wait_for(pool.solve(0.0, 60.0), HANGS_S) == b"whole"
        with suppress(SolverFailed):  # twice beside a process that died
            await long

    run(test, half_an_answer, count=2, grace_s=3600.0)


def test_draining_finishes_what_was_begun_and_gives_up_what_waits():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        begun, in_line = (asyncio.create_task(pool.solve(0.4, 60.0)) for _ in range(2))
        await asyncio.sleep(0.1)
        await pool.drain()
        assert pool.waiting == 0
        assert begun.result() is None
        problem = translate(in_line.exception())
        assert (problem.name, "Retry-After" in problem.headers) == ("shutting-down", True)
        with pytest.raises(PlanningEnded):
            await pool.solve(0.0, 60.0)

    run(test, time.sleep, queue=1)


def test_signals_to_the_group_leave_a_plan_to_its_end():
    async def test(pool: PlannerPool) -> None:
        await pool.warm_up()
        (worker,) = pool._executor._processes.values()
        job = asyncio.create_task(pool.solve(0.5, 60.0))
        await asyncio.sleep(0.1)
        for number in (signal.SIGTERM, signal.SIGINT):
            os.kill(worker.pid, number)
        assert await job is None
        assert list(pool._executor._processes.values()) == [worker]

    run(test, time.sleep, whole=True)
