"""Batches on a Ray cluster: two nodes as processes of this machine. Skipped where Ray is not installed."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.batches.cluster import LocalCluster
from benchmarks.batches.problems import batch_requests
from jobs.planning import PlanningJob
from jobs.pool import PoolBroken, open_pool
from planner.cell import read_source
from tests.jobs.fake_planner import FAKE, fake_job

pytest.importorskip("ray", reason="RAY IS NOT INSTALLED: batches on a cluster are not verified")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
pytestmark += [pytest.mark.filterwarnings("default")]  # Ray's own warnings are its own


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster() as cluster:
        yield cluster


def test_a_worker_and_a_node_may_be_killed(cluster: LocalCluster):
    numbers: Counter[int] = Counter()
    with open_pool(None, cluster.address, work=FAKE) as pool:
        assert pool.workers == 2
        for result in pool.plan_all(fake_job(value, sleep_s=0.01) for value in range(600)):
            assert result.planned.row.samples == str(result.number**2).encode()
            numbers[result.number] += 1
            if len(numbers) == 100:
                os.kill(int(result.planned.row.summary), signal.SIGKILL)
            if len(numbers) == 300:
                cluster.kill_node()
    assert numbers == dict.fromkeys(range(600), 1)


def test_a_job_that_kills_its_worker_twice_is_refused(cluster: LocalCluster):
    with open_pool(1, cluster.address, work=FAKE) as pool:
        results = {result.number: result for result in pool.plan_all([fake_job(), fake_job(dies=True), fake_job()])}
    assert "died twice over this request" in results[1].refusal["detail"]
    assert results[0].planned and results[2].planned


def test_the_answers_are_those_of_processes_of_this_machine(cluster: LocalCluster, root: Path):
    source = read_source(root / "cells" / "ur5e-sim.toml")
    jobs = [PlanningJob("id", 0.0, source, {**request, "cell": "ur5e-sim"}) for request in batch_requests(40)]
    answers = []
    for address in (None, cluster.address):
        with open_pool(2, address) as pool:
            found = {result.number: result for result in pool.plan_all(jobs)}
        answers.append(
            [(found[n].planned and found[n].planned.row.samples, found[n].refusal) for n in range(len(jobs))]
        )
    assert answers[0] == answers[1]
    assert sum(samples is not None for samples, _ in answers[0]) > 20


def test_where_there_is_no_cluster():
    with pytest.raises(PoolBroken, match=r"no Ray cluster at '127.0.51.9:1'"):
        open_pool(1, "127.0.51.9:1", work=FAKE)
