"""The line in front of the planner processes: bounded, given up by who leaves, emptied at the end."""

from __future__ import annotations

import asyncio
import os
import signal
import struct
from collections.abc import Callable, Coroutine
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import pytest

from api.http import translate
from api.planning import ClientGone, PlanningEnded, PlanningLine, PlanningQueueFull
from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import NICENESS, Work, open_pool
from planner.errors import SolverFailed
from planner.progress import Observer, Progress
from tests.jobs.fake_planner import FAKE, fake_job, fake_solve

HANGS_S = 180.0  # [s] processes are started anew before, on a busy machine


def run(
    test: Callable[[PlanningLine], Coroutine[Any, Any, None]], *, count: int = 1, queue: int = 0, **options: Any
) -> None:
    async def whole() -> None:
        options.setdefault("work", FAKE)
        with open_pool(count, **options) as pool:
            await asyncio.to_thread(pool.wait_until_warm)
            line = PlanningLine(pool, queue)
            assert line.is_warm
            await test(line)

    asyncio.run(whole())


def process_of(planned: PlanRecord) -> int:
    return int(planned.row.summary)


def test_a_full_queue_is_answered_with_a_time_to_retry():
    async def test(line: PlanningLine) -> None:
        first = asyncio.create_task(line.solve(fake_job(sleep_s=0.5)))
        await asyncio.sleep(0.05)
        assert line.waiting == 1
        with pytest.raises(PlanningQueueFull) as caught:
            await line.solve(fake_job())
        problem = translate(caught.value)
        assert problem.name == "overloaded"
        assert int(problem.headers["Retry-After"]) >= 1
        await first
        assert line.waiting == 0

    run(test)


def test_a_client_that_left_gives_up_its_place_in_line():
    async def test(line: PlanningLine) -> None:
        gone = asyncio.Event()
        first = asyncio.create_task(line.solve(fake_job(sleep_s=0.4), gone))
        await asyncio.sleep(0.05)
        second = asyncio.create_task(line.solve(fake_job(sleep_s=3600.0), gone))
        await asyncio.sleep(0.05)
        assert line.waiting == 2
        gone.set()
        for left in (first, second):
            with pytest.raises(ClientGone):
                await left
        await asyncio.wait_for(line.solve(fake_job()), HANGS_S)  # the place is free again
        assert line.waiting == 0

    run(test, queue=2)


def test_a_search_whose_client_has_left_ends_in_its_worker():
    async def test(line: PlanningLine) -> None:
        worker = process_of(await line.solve(fake_job()))
        gone = asyncio.Event()
        told: list[Progress] = []

        def follow(progress: Progress) -> None:
            told.append(progress)
            if progress.candidates == 3:
                gone.set()

        with pytest.raises(ClientGone):
            await line.solve(replace(fake_job(steps=1_000_000), tells_progress=True), gone, follow)
        assert [progress.candidates for progress in told[:3]] == [1, 2, 3]
        after = await asyncio.wait_for(line.solve(fake_job()), HANGS_S)
        assert process_of(after) == worker  # which was asked, and not killed

    run(test, grace_s=3600.0)


@pytest.mark.slow
def test_a_worker_that_hears_of_nothing_is_replaced_once_its_client_has_left():
    async def test(line: PlanningLine) -> None:
        worker = process_of(await line.solve(fake_job()))
        solving = asyncio.create_task(line.solve(fake_job(sleep_s=3600.0)))
        await asyncio.sleep(0.1)
        solving.cancel()
        after = await asyncio.wait_for(line.solve(fake_job()), HANGS_S)
        assert process_of(after) != worker

    run(test, queue=2, grace_s=3600.0)


def test_progress_is_told_where_it_is_asked_for_alone():
    async def test(line: PlanningLine) -> None:
        told: list[Progress] = []
        await line.solve(fake_job(steps=3), None, told.append)
        assert told == []
        await line.solve(replace(fake_job(steps=3), tells_progress=True), None, told.append)
        assert [progress.candidates for progress in told] == [1, 2, 3]

    run(test)


def test_the_loop_is_free_while_a_worker_works():
    async def test(line: PlanningLine) -> None:
        solving = asyncio.create_task(line.solve(fake_job(sleep_s=0.5)))
        for _ in range(10):
            await asyncio.sleep(0.01)
            assert not solving.done()
        await solving

    run(test)


@pytest.mark.slow
def test_a_hung_worker_is_killed_and_the_next_job_is_done():
    async def test(line: PlanningLine) -> None:
        with pytest.raises(SolverFailed) as caught:
            await line.solve(fake_job(sleep_s=3600.0, time_limit_s=0.1))
        assert translate(caught.value).name == "solver-failed"
        assert (await line.solve(fake_job(3))).row.samples == b"9"

    run(test, grace_s=0.1)


@pytest.mark.slow
def test_a_job_that_kills_its_worker_is_given_up_and_the_queue_goes_on():
    async def test(line: PlanningLine) -> None:
        with pytest.raises(SolverFailed) as caught:
            await line.solve(fake_job(dies=True))
        problem = translate(caught.value)
        assert problem.name == "solver-failed"
        assert "died" in problem.detail
        assert (await line.solve(fake_job(3))).row.samples == b"9"

    run(test)


def test_a_bug_of_the_planner_is_told_from_a_search_that_failed():
    async def test(line: PlanningLine) -> None:
        with pytest.raises(SolverFailed) as caught:
            await line.solve(fake_job(bug=True))
        assert translate(caught.value).name == "internal"

    run(test)


@pytest.mark.slow
def test_a_planner_that_cannot_start_is_a_service_that_is_not_ready():
    async def test() -> None:
        with open_pool(1, work=Work(fake_solve, fake_solve, fake_job(dies=True), 0)) as pool:
            with pytest.raises(Exception, match="ended before they were ready") as caught:
                await PlanningLine(pool, 0).solve(fake_job())
            problem = translate(caught.value)
            assert (problem.name, "Retry-After" in problem.headers) == ("not-ready", True)

    asyncio.run(test())


@pytest.mark.slow
def test_a_worker_killed_from_outside_costs_nothing_but_time():
    async def test(line: PlanningLine) -> None:
        victim = process_of(await line.solve(fake_job()))
        job = asyncio.create_task(line.solve(fake_job(3, sleep_s=1.0)))
        await asyncio.sleep(0.2)
        os.kill(victim, signal.SIGKILL)
        planned = await job
        assert planned.row.samples == b"9"
        assert process_of(planned) != victim

    run(test)


def half_an_answer(job: PlanningJob, observer: Observer | None) -> PlanRecord:
    """Answers; a job that says so has its process killed in the middle of that."""

    def half(connection: Connection, buffer: bytes) -> None:
        os.write(connection.fileno(), struct.pack("!i", len(buffer)) + bytes(buffer[: len(buffer) // 2]))
        os.kill(os.getpid(), signal.SIGKILL)

    if job.request.get("half"):
        Connection._send_bytes = half  # type: ignore[attr-defined]
    return fake_solve(job, observer)


@pytest.mark.slow
def test_a_worker_killed_within_its_answer_concerns_its_own_job_alone():
    async def test(line: PlanningLine) -> None:
        long = asyncio.create_task(line.solve(fake_job(2, sleep_s=2.0)))
        with pytest.raises(SolverFailed, match="died"):
            await line.solve(fake_job(half=True, sleep_s=0.2))
        assert (await asyncio.wait_for(line.solve(fake_job(3)), HANGS_S)).row.samples == b"9"
        assert (await long).row.samples == b"4"

    run(test, count=2, grace_s=3600.0, work=Work(FAKE.load, half_an_answer, niceness=0))


def test_draining_finishes_what_was_begun_and_gives_up_what_waits():
    async def test(line: PlanningLine) -> None:
        begun, in_line = (asyncio.create_task(line.solve(fake_job(3, sleep_s=0.4))) for _ in range(2))
        await asyncio.sleep(0.1)
        await line.drain()
        assert line.waiting == 0
        await asyncio.wait((begun, in_line))
        assert begun.result().row.samples == b"9"
        problem = translate(in_line.exception())
        assert (problem.name, "Retry-After" in problem.headers) == ("shutting-down", True)
        with pytest.raises(PlanningEnded):
            await line.solve(fake_job())

    run(test, queue=1)


def test_signals_to_the_group_leave_a_plan_to_its_end():
    async def test(line: PlanningLine) -> None:
        worker = process_of(await line.solve(fake_job()))
        job = asyncio.create_task(line.solve(fake_job(sleep_s=0.5)))
        await asyncio.sleep(0.1)
        for number in (signal.SIGTERM, signal.SIGINT):
            os.kill(worker, number)
        assert process_of(await job) == worker

    run(test)


def niceness(job: PlanningJob, observer: Observer | None) -> PlanRecord:
    planned = fake_solve(job, observer)
    return PlanRecord(planned.row, float(os.nice(0)), 1.0)


@pytest.mark.slow
def test_planning_leaves_the_processor_to_the_stream():
    async def test(line: PlanningLine) -> None:
        assert (await line.solve(fake_job())).release_time_s == os.nice(0) + NICENESS

    run(test, work=Work(FAKE.load, niceness))
