"""Workers that are actors of a Ray cluster: warm ones, a core each.

Ray plans nothing again by itself: actors and their tasks are never restarted, so that a lost result is the pool's
affair alone, whatever engine it has.
"""

from __future__ import annotations

import os
import socket
import time
from importlib import import_module
from typing import Any

from jobs.planning import PlanningJob
from jobs.pool.worker import JobResult, PoolBroken, Report, Work

POLL_S = 0.05  # [s] between two looks for new jobs: nothing wakes Ray, and plans take longer
CONNECT_S = 5.0  # [s] within which a cluster's head node accepts a connection
LINE_MAX = 160  # characters of a line of Ray's errors that are kept
ADVICE = "Ray is not installed: pip install 'fling-robotics[ray]'"


class RayPlanner:
    """A planner in a process of a Ray cluster."""

    def __init__(self, work: Work) -> None:
        self._work = work
        work.begin()

    def is_ready(self) -> None:
        """Returns once this planner is warm."""

    def plan(self, job: PlanningJob) -> JobResult:
        """Returns the result of a job."""
        return self._work.answer(job)


class RayEngine:
    """Actors of a Ray cluster; see `Engine`.

    No actor tells the progress of a search: clusters plan batches, whose progress is counted in plans.

    Args:
        address: of the cluster, such as `10.0.0.1:6379`; `auto` finds the one of this machine, `local` starts one.
        count: Number of actors; None: one a core of the cluster, as it is now.
        work: What an actor does.

    Raises:
        PoolBroken: Ray is not installed, or there is no cluster at this address.
    """

    def __init__(self, address: str, count: int | None, work: Work) -> None:
        self._ray = _connect(address)
        self.count = count or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._work = work
        options = {"num_cpus": 1, "max_restarts": 0, "max_task_retries": 0}
        self._kind: Any = self._ray.remote(**options)(RayPlanner)
        self._actors: dict[int, Any] = {}
        self._awaited: dict[Any, int] = {}  # what the engine waits for: an actor to be ready, the result of a job
        for worker in range(self.count):
            self._start(worker)

    def give(self, worker: int, job: PlanningJob) -> None:
        """Gives a job to a worker that has none."""
        self._awaited[self._actors[worker].plan.remote(job)] = worker

    def cancel(self, worker: int) -> None:
        """Does nothing: an actor hears of nothing while it plans. It is replaced, as it does not answer."""

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report, or for `POLL_S`."""
        timeout_s = min(timeout_s, POLL_S)
        awaited = list(self._awaited)
        if not awaited:
            time.sleep(timeout_s)
            return []
        ready, _ = self._ray.wait(awaited, num_returns=1, timeout=timeout_s)
        if ready and len(awaited) > 1:
            ready, _ = self._ray.wait(awaited, num_returns=len(awaited), timeout=0)
        return [self._report(self._awaited.pop(one), one) for one in ready]

    def wake(self) -> None:
        """Does nothing: `reports` returns soon."""

    def replace(self, worker: int) -> None:
        """Ends a worker, dead or alive, and starts another in its place; that waits for a free core."""
        self._end(worker)
        self._start(worker)

    def close(self) -> None:
        """Ends all actors, and leaves the cluster."""
        for worker in list(self._actors):
            self._end(worker)
        self._ray.shutdown()

    def _report(self, worker: int, awaited: Any) -> Report:
        try:
            return Report(worker, result=self._ray.get(awaited))
        except self._ray.exceptions.RayError as error:
            is_bug = isinstance(error, self._ray.exceptions.RayTaskError)
            return Report(worker, death=_words(error), is_bug=is_bug)

    def _start(self, worker: int) -> None:
        self._actors[worker] = self._kind.remote(self._work)
        self._awaited[self._actors[worker].is_ready.remote()] = worker

    def _end(self, worker: int) -> None:
        self._ray.kill(self._actors.pop(worker))
        self._awaited = {one: whose for one, whose in self._awaited.items() if whose != worker}


def _connect(address: str) -> Any:
    """Returns the library, connected to a cluster. Nothing is reported to anybody."""
    if address.startswith("ray://"):
        raise PoolBroken(f"{address}: ray:// is not supported; run on a machine of the cluster")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        ray: Any = import_module("ray")
    except ImportError:
        raise PoolBroken(ADVICE) from None
    _require_answer(address)
    try:
        ray.init(address=address, log_to_driver=False, logging_level="warning")
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise PoolBroken(f"no Ray cluster at {address!r}: {error}") from error
    return ray


def _require_answer(address: str) -> None:
    """Checks that somebody listens at host and port: Ray tries for minutes, and then ends the process."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():  # auto, local
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()
    except (OSError, OverflowError) as error:
        raise PoolBroken(f"no Ray cluster at {address!r}: {error}") from error


def _words(error: Exception) -> str:
    """Returns the first and the last line of an error: Ray's messages are pages long."""
    lines = [line.strip()[:LINE_MAX] for line in str(error).splitlines() if line.strip()]
    return " … ".join(dict.fromkeys([*lines[:1], *lines[-1:]])) or type(error).__name__
