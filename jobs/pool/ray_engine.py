"""Workers that are actors of a Ray cluster: warm ones, a core each, whose results come as they are made.

Ray plans nothing again by itself: actors and their tasks are never restarted, so that a lost result is the pool's
affair alone, whatever engine it has.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from jobs.planning import PlanningJob
from jobs.pool.planning_pool import PoolBroken, Report
from jobs.pool.results import Chunk, JobResult, Work, answer

CONNECT_S = 5.0  # [s] within which a cluster's head node accepts a connection
LINE_MAX = 160  # characters of a line of Ray's errors that are kept
ADVICE = "Ray is not installed: pip install 'fling-robotics[ray]'"


class RayPlanner:
    """A planner in a process of a Ray cluster."""

    def __init__(self, warm_up: PlanningJob | None, work: Work) -> None:
        self._work = work
        work.load(warm_up)

    def is_ready(self) -> bool:
        """Returns True, once this planner is warm."""
        return True

    def plan(self, chunk: Chunk) -> Iterator[JobResult]:
        """Yields the results of a chunk."""
        for number, job in chunk:
            yield answer(number, job, self._work)


class RayEngine:
    """Actors of a Ray cluster; see `Engine`.

    Args:
        address: of the cluster, such as `10.0.0.1:6379`; `auto` finds the one of this machine, `local` starts one.
        count: Number of actors; None: one a core of the cluster, as it is now.
        warm_up: Planned by each actor when it starts.
        work: What an actor does.

    Raises:
        PoolBroken: Ray is not installed, or there is no cluster at this address.
    """

    def __init__(self, address: str, count: int | None, warm_up: PlanningJob | None, work: Work) -> None:
        self._ray = _connect(address)
        self.count = count or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._warm_up = warm_up
        self._work = work
        options = {"num_cpus": 1, "max_restarts": 0, "max_task_retries": 0}
        self._kind: Any = self._ray.remote(**options)(RayPlanner)
        self._actors: dict[int, Any] = {}
        self._awaited: dict[Any, int] = {}  # what the engine waits for: an actor to be ready, the results of a chunk
        for worker in range(self.count):
            self._start(worker)

    def give(self, worker: int, chunk: Chunk) -> None:
        """Gives a chunk to a worker that is ready."""
        results = self._actors[worker].plan.options(num_returns="streaming").remote(chunk)
        self._awaited[results] = worker

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report."""
        awaited = list(self._awaited)
        ready, _ = self._ray.wait(awaited, num_returns=1, timeout=timeout_s)
        if ready and len(awaited) > 1:
            ready, _ = self._ray.wait(awaited, num_returns=len(awaited), timeout=0)
        return [self._report(self._awaited[one], one) for one in ready]

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
            if isinstance(awaited, self._ray.ObjectRef):
                self._ray.get(awaited)
                result = None
            else:
                result = self._ray.get(next(awaited))
        except StopIteration:
            result = None
        except self._ray.exceptions.RayError as error:
            return Report(worker, death=_words(error))
        if result is None:
            del self._awaited[awaited]
        return Report(worker, result)

    def _start(self, worker: int) -> None:
        self._actors[worker] = self._kind.remote(self._warm_up, self._work)
        self._awaited[self._actors[worker].is_ready.remote()] = worker

    def _end(self, worker: int) -> None:
        self._ray.kill(self._actors.pop(worker))
        self._awaited = {one: whose for one, whose in self._awaited.items() if whose != worker}


def _connect(address: str) -> Any:
    """Returns the library, connected to a cluster. Nothing is reported to anybody."""
    if address.startswith("ray://"):
        raise PoolBroken(f"{address}: results cannot be streamed over ray://; run on a machine of the cluster")
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
