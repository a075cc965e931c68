"""The pool of planning workers, in real processes whose work is a fake: order, bounds, deaths."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from jobs.planning import PlanningJob
from jobs.pool import PlannerBug, PlannerPool, PoolBroken, open_pool
from jobs.pool.pool import AHEAD
from tests.jobs.fake_planner import FAKE, fake_job
from tests.waiting import until


@pytest.fixture(scope="module")
def pool() -> Iterator[PlannerPool]:
    with open_pool(2, work=FAKE, grace_s=0.5) as pool:
        pool.wait_until_warm()
        yield pool


def test_every_job_has_its_own_result(pool: PlannerPool):
    results = list(pool.plan_all(fake_job(value, infeasible=value == 7) for value in range(50)))
    assert sorted(result.number for result in results) == list(range(50))
    planned = {result.number: result.planned.row.samples for result in results if result.planned}
    assert planned == {number: str(number**2).encode() for number in range(50) if number != 7}
    (refused,) = [result for result in results if result.refusal]
    assert refused.number == 7
    assert refused.refusal["name"] == "infeasible"
    assert refused.refusal["violations"][0]["constraint"] == "floor"
    assert refused.refusal["violations"][0]["proven"] is True
    assert refused.refusal["nearest"] == {"release": {}}
    assert len({result.planned.row.summary for result in results if result.planned}) == 2  # both processes worked


def test_results_come_in_the_order_in_which_they_are_made(pool: PlannerPool):
    results = pool.plan_all([fake_job(sleep_s=1.0), *(fake_job() for _ in range(20))])
    assert 0 not in [next(results).number for _ in range(5)]
    assert len(list(results)) == 16


def test_jobs_are_read_as_they_are_needed(pool: PlannerPool):
    read = 0

    def endless() -> Iterator[PlanningJob]:
        nonlocal read
        while True:
            read += 1
            yield fake_job(sleep_s=0.001)

    results = pool.plan_all(endless())
    answered = [next(results) for _ in range(10)]
    assert len(answered) < read <= (AHEAD + 1) * pool.workers + len(answered)
    results.close()
    assert [result.number for result in pool.plan_all([fake_job()])] == [0]  # nothing of the call before comes late


@pytest.mark.slow
def test_what_a_dead_worker_had_in_hand_is_given_out_again(pool: PlannerPool, tmp_path: Path):
    jobs = [fake_job(value, sleep_s=0.002) for value in range(100)]
    jobs[90] = fake_job(90, dies_once=str(tmp_path / "died"))  # not in hand of the worker that is ended before it
    numbers = Counter()
    for result in pool.plan_all(jobs):
        assert result.planned.row.samples == str(result.number**2).encode()
        numbers[result.number] += 1
        if len(numbers) == 20:
            os.kill(int(result.planned.row.summary), signal.SIGKILL)  # somebody ends a worker from outside
    assert numbers == dict.fromkeys(range(100), 1)
    assert (tmp_path / "died").exists()


@pytest.mark.slow
def test_a_job_that_kills_its_worker_twice_is_refused(pool: PlannerPool):
    results = {result.number: result for result in pool.plan_all([fake_job(), fake_job(dies=True), fake_job()])}
    assert results[1].refusal["name"] == "solver-failed"
    assert "died twice over this request: exit status -9" in results[1].refusal["detail"]
    assert results[0].planned and results[2].planned


def test_a_bug_is_a_refusal_too(pool: PlannerPool):
    (result,) = pool.plan_all([fake_job(bug=True)])
    assert isinstance(result.error, PlannerBug)
    assert "a bug ended the planner process" in result.refusal["detail"]


def test_a_bug_of_a_cancelled_job_is_told_as_a_bug(pool: PlannerPool):
    future = pool.submit(fake_job(sleep_s=0.3, bug=True))
    until(future.running)
    pool.cancel(future)
    assert isinstance(future.result(timeout=10.0).error, PlannerBug)


def test_a_worker_that_does_not_answer_is_replaced(pool: PlannerPool):
    jobs = [fake_job(sleep_s=3600.0, time_limit_s=0.1), fake_job(1), fake_job(2)]
    results = {result.number: result for result in pool.plan_all(jobs)}
    assert "no answer within 0.6 s" in results[0].refusal["detail"]
    assert [results[number].planned.row.samples for number in (1, 2)] == [b"1", b"4"]


@pytest.mark.slow
def test_workers_that_cannot_start_end_the_call():
    with open_pool(1, work=replace(FAKE, warm_up=fake_job(dies=True))) as pool:
        with pytest.raises(PoolBroken, match="no planner process can be started"):
            pool.wait_until_warm()
        for _ in range(2):  # whoever asks again has it tried again
            with pytest.raises(PoolBroken, match="status -9"):
                list(pool.plan_all([fake_job()]))


def test_a_job_that_is_cancelled_in_line_is_not_planned(tmp_path: Path):
    with open_pool(1, work=FAKE) as pool:
        pool.wait_until_warm()
        busy = pool.submit(fake_job(sleep_s=0.5))
        waits = pool.submit(fake_job(log=str(tmp_path / "log"), dies_once=str(tmp_path / "begun")))
        after = pool.submit(fake_job(3))
        until(busy.running)
        assert waits.cancel()
        assert not busy.cancel()
        assert after.result(timeout=60.0).planned.row.samples == b"9"
    assert not (tmp_path / "begun").exists()


@pytest.mark.slow
def test_a_closed_pool_leaves_nobody_waiting():
    with open_pool(1, work=FAKE) as pool:
        pool.wait_until_warm()
        begun = pool.submit(fake_job(sleep_s=3600.0))
        waits = pool.submit(fake_job())
        until(begun.running)
    assert waits.cancelled()
    with pytest.raises(PoolBroken):
        begun.result(timeout=1.0)
