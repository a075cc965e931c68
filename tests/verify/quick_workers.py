"""Stand-ins for executor and planner processes: they answer at once, so that there is something to read.

What is fuzzed is the service. Its plans are real; executions, batches and maps would take minutes each.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial

from jobs.batches import DrivenBatch
from jobs.driver import drive
from jobs.maps import DrivenMap, map_inputs
from jobs.planning import PlanningJob
from jobs.pool import JobResult
from planner.errors import Infeasible, Violation
from store import BatchLost, JobLost, Store, pack_samples
from tests.api.conftest import beat_as

BEAT_S = 0.05
WORK_S = 2.0  # [s] for one batch or map; what is not answered then is cancelled: one may have 100,000 requests
TELEMETRY = {name: [0.1] * 6 for name in ("positions", "velocities", "planned_positions", "planned_velocities")}
TELEMETRY |= {"clock_s": 0.1, "missed_ticks": 0}
REFUSAL = Infeasible([Violation("floor", -0.1, 0.02, "m", proven=True)], {"release": {}})


class QuickWorker:
    """A thread that works on a store every now and then."""

    def __init__(self, url: str) -> None:
        self._store, self._ended = Store.open(url), threading.Event()
        self._thread = threading.Thread(target=self._go_on)

    def __enter__(self) -> None:
        self._work()  # a cell has an executor from the first heartbeat on
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._store.close()

    def _go_on(self) -> None:
        while not self._ended.wait(BEAT_S):
            self._work()

    def _work(self) -> None:
        raise NotImplementedError


class QuickExecutor(QuickWorker):
    """Finishes every execution at once, so that there is something to read, watch, abort and report."""

    def __init__(self, url: str, cell: str) -> None:
        super().__init__(url)
        self._cell = cell

    def _work(self) -> None:
        beat_as(self._store, "quick", self._cell, "sim", {"positions": [0.1] * 6})
        row = self._store.claim_execution(self._cell, "quick")
        if row is not None:
            self._store.add_event(row.id, "telemetry", TELEMETRY)
            self._store.add_recording(row.id, b"\x89MCAP0\r\n", pack_samples(["t"], [[0.0]]))
            self._store.finish_execution(row.id, "completed", None, {"released": True, "ticks": 3})


class QuickPlanner(QuickWorker):
    """Drives batches, maps and jobs as the service does; refuses every request, and completes jobs as they are."""

    def _work(self) -> None:
        for row in self._store.unfinished_batches("service"):
            with suppress(BatchLost):  # it was cancelled meanwhile
                task = DrivenBatch(self._store, self._store.claim_batch(row.id, "quick"))
                drive(task, partial(refuse_all, partial(self._store.cancel_batch, row.id)))
        for row in self._store.running_maps("service"):
            task = DrivenMap(self._store, row, map_inputs(self._store, row))
            drive(task, partial(refuse_all, partial(self._store.request_map_cancel, row.id)))
        for row in self._store.unfinished_jobs():
            with suppress(JobLost):  # it was cancelled meanwhile
                self._store.claim_job(row.id, "quick")
                self._store.finish_job(row.id, "quick", "completed")


def refuse_all(
    give_up: Callable[[], object], jobs: Iterable[PlanningJob], must_stop: Callable[[], bool]
) -> Iterator[JobResult]:
    """Refuses jobs while there is time, then gives up what they are for."""
    until = time.monotonic() + WORK_S
    for number, _ in enumerate(jobs):
        if must_stop():
            return
        if time.monotonic() > until:
            give_up()
            return
        yield JobResult(None, REFUSAL, number=number)
