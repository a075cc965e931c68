"""The planner's processes: bounded, killed when they hang, rebuilt when they die. `time.sleep` plays a solver."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from api.errors import Problem
from api.workers import Workers


def run(test: Callable[[Workers], Coroutine[Any, Any, None]], solve: Callable[[Any], Any], **options: Any) -> None:
    async def whole() -> None:
        workers = Workers(options.pop("count", 1), options.pop("queue", 0), None, solve, **options)
        try:
            await test(workers)
        finally:
            workers.close()

    asyncio.run(whole())


def test_a_full_line_is_told_to_come_back():
    async def test(workers: Workers) -> None:
        await workers.warm()
        first = asyncio.create_task(workers.solve(0.5, 60.0))
        await asyncio.sleep(0.05)
        assert workers.waiting == 1
        with pytest.raises(Problem) as caught:
            await workers.solve(0.5, 60.0)
        assert caught.value.name == "overloaded"
        assert int(caught.value.headers["Retry-After"]) >= 1
        await first
        assert workers.waiting == 0

    run(test, time.sleep)


def test_the_loop_is_free_while_a_worker_works():
    async def test(workers: Workers) -> None:
        await workers.warm()
        solving = asyncio.create_task(workers.solve(0.5, 60.0))
        for _ in range(10):
            await asyncio.sleep(0.01)
            assert not solving.done()
        await solving

    run(test, time.sleep)


def test_one_that_hangs_is_ended_and_the_next_job_is_done():
    async def test(workers: Workers) -> None:
        await workers.warm()
        with pytest.raises(Problem) as caught:
            await workers.solve(3600.0, 0.1)
        assert caught.value.name == "solver-failed"
        assert await workers.solve(0.0, 60.0) is None

    run(test, time.sleep, grace_s=0.1)


def test_a_job_that_kills_its_worker_is_given_up_and_the_line_goes_on():
    async def test(workers: Workers) -> None:
        with pytest.raises(Problem) as caught:
            await workers.solve(3, 60.0)
        assert caught.value.name == "solver-failed"
        assert "died" in caught.value.detail
        await workers.warm()

    run(test, os._exit)


def test_a_worker_killed_from_outside_costs_nothing_but_time():
    async def test(workers: Workers) -> None:
        await workers.warm()
        (victim,) = workers._pool._processes.values()
        job = asyncio.create_task(workers.solve(1.0, 60.0))
        await asyncio.sleep(0.2)
        victim.kill()
        assert await job is None

    run(test, time.sleep)
