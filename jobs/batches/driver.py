"""The driver of a batch: plans in a pool what has no result yet, and stores each result once.

It may be killed at any time: whoever drives the batch next begins with what is not stored.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import orjson

from jobs.batches.specification import BatchSpecification, CellUse, plan_id, problem_sha256
from jobs.batches.writer import GROUP, LINE, ResultWriter
from jobs.planning import PlanningJob, warm_up_job
from jobs.pool import PLANNING, JobResult, PlanningPool, Work, open_pool
from planner.cell import CellSource
from store import BatchDriven, BatchResultRow, BatchRow, PlanRow, Store

CLAIM_POLL_S = 0.5  # [s] between two attempts to take over a batch whose driver may have died
CLAIM_S = 15.0  # [s] after which it must have been alive
WARM_UP_FROM = 100  # requests left from which on each worker warms up first: a second that pays later


def wait_and_claim(store: Store, batch_id: str, driver_id: str, wait_s: float = CLAIM_S) -> BatchRow:
    """Claims a batch; waits until its former driver is taken for dead.

    Raises:
        BatchDriven: Another driver has it, and is alive.
        BatchLost, UnknownBatch: It is finished; there is none.
    """
    until = time.monotonic() + wait_s
    while True:
        try:
            return store.claim_batch(batch_id, driver_id)
        except BatchDriven:
            if time.monotonic() > until:
                raise
        time.sleep(CLAIM_POLL_S)


class BatchDriver:
    """Plans one batch; see `run`.

    Args:
        store: of the batch.
        row: the batch, claimed by this driver.
        workers: Number of workers; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
        on_progress: called with the batch whenever results were stored, in another thread.
        work: What a worker does; replaced in tests.
    """

    def __init__(
        self,
        store: Store,
        row: BatchRow,
        workers: int | None = None,
        ray_address: str | None = None,
        on_progress: Callable[[BatchRow], None] = lambda _: None,
        work: Work = PLANNING,
    ) -> None:
        assert row.driver_id is not None  # it has just been claimed
        self._store = store
        self._row = row
        self._specification = BatchSpecification.stored(store, row.id)
        self._sources = {name: self._source(name, use) for name, use in self._specification.cells.items()}
        self._profiles = {name: self._profile(use) for name, use in self._specification.cells.items()}
        self._workers = workers
        self._ray_address = ray_address
        self._work = work
        self._on_progress = on_progress
        self._is_stopped = False
        self._given: dict[int, str] = {}  # problem of each job in the pool
        self._open: dict[str, list[int]] = {}  # numbers of the requests that ask for it
        self._jobs = 0
        self._recent: OrderedDict[str, BatchResultRow] = OrderedDict()  # longer than what waits to be written

    def stop(self) -> None:
        """Makes `run` return soon, with what is planned until then; for signal handlers and other threads."""
        self._is_stopped = True

    def run(self) -> BatchRow:
        """Plans until the batch is finished, cancelled or stopped; returns it. A stopped one can be taken up again.

        Raises:
            BatchLost: Another driver has taken it over.
            PoolBroken: No worker can be started.
        """
        writer = ResultWriter(self._store, self._row, self._on_progress)
        try:
            with writer:
                if self._row.done < self._row.total and not writer.is_cancelled:
                    self._plan(writer)
            if writer.loss is not None:
                raise writer.loss
        finally:
            row = self._let_go(writer)
        return row

    def _let_go(self, writer: ResultWriter) -> BatchRow:
        """Finishes the batch, or puts it back into the queue; returns it."""
        row = self._store.batch(self._row.id) or self._row
        if writer.loss is not None:
            return row
        if row.done == row.total:
            self._store.finish_batch(row.id, "completed")
        elif writer.is_cancelled:
            self._store.finish_batch(row.id, "cancelled")
        else:
            self._store.release_batch(row.id, str(row.driver_id))
        return self._store.batch(row.id) or row

    def _plan(self, writer: ResultWriter) -> None:
        left = self._row.total - self._row.done
        warm_up = warm_up_job(next(iter(self._sources.values()))) if left >= WARM_UP_FROM else None
        with open_pool(self._pool_size(left), self._ray_address, warm_up, self._work) as pool:
            self._plan_in(pool, writer)

    def _plan_in(self, pool: PlanningPool, writer: ResultWriter) -> None:
        def must_stop() -> bool:
            return self._is_stopped or writer.must_stop

        for result in pool.plan_all(self._todo(writer), must_stop):
            sha256 = self._given.pop(result.number)
            first, *others = self._open.pop(sha256)
            row, plan = self._stored(first, sha256, result)
            writer.put(row, plan)
            self._remember(row)
            for number in others:
                writer.put(replace(row, number=number), None)

    def _todo(self, writer: ResultWriter) -> Iterator[PlanningJob]:
        """Yields a job for each problem that has no result; a problem that was planned already answers at once."""
        done = bytearray(self._row.total)
        for number in self._store.batch_numbers(self._row.id):
            done[number] = 1
        for number, request in self._specification.numbered():
            if done[number]:
                continue
            source = self._sources[request["cell"]]
            sha256 = problem_sha256(request, source.sha256, self._specification.cells[source.name].profile)
            if sha256 in self._open:
                self._open[sha256].append(number)
                continue
            known = self._recent.get(sha256) or self._store.batch_result_of(self._row.id, sha256)
            if known is not None:
                writer.put(replace(known, number=number), None)
                continue
            self._open[sha256] = [number]
            self._given[self._jobs] = sha256
            self._jobs += 1
            yield self._job(request, source, sha256)

    def _job(self, request: Any, source: CellSource, sha256: str) -> PlanningJob:
        version = self._specification.cells[source.name].version
        id = plan_id(self._row.id, sha256)
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        at = at.replace("+00:00", "Z")
        return PlanningJob(id, at, source, request, self._profiles[source.name], self._row.request_id, version)

    def _stored(self, number: int, sha256: str, result: JobResult) -> tuple[BatchResultRow, PlanRow | None]:
        """Returns the rows of a result and of its plan."""
        head = {"batch_id": self._row.id, "number": number, "problem_sha256": sha256}
        head |= {"planning_time_s": result.duration_s}
        if result.planned is None:
            refusal = result.refusal or {}
            return BatchResultRow(**head, outcome=refusal["name"], refusal=refusal), None
        made = result.planned
        plan = orjson.loads(result.planned.summary)
        id = plan_id(self._row.id, sha256)
        flight = plan["flight"] or {}
        row = BatchResultRow(
            **head,
            outcome="planned",
            plan_id=id,
            trajectory_sha256=hashlib.sha256(made.samples).hexdigest(),
            release_time_s=plan["release_time_s"],
            duration_s=plan["duration_s"],
            release_speed_m_s=flight.get("speed_m_s"),
            hit_probability=(plan.get("hit_probability") or {}).get("value"),
        )
        cell = plan["cell"], plan["cell_sha256"]
        request_id = self._row.request_id
        return row, PlanRow(id, time.time(), *cell, made.backend, made.summary, request_id, made.samples)

    def _remember(self, row: BatchResultRow) -> None:
        self._recent[row.problem_sha256] = row
        while len(self._recent) > 2 * (LINE + GROUP):
            self._recent.popitem(last=False)

    def _pool_size(self, left: int) -> int | None:
        """Returns the number of workers, no more than requests are left; None: one a core of the cluster."""
        if self._workers is None and self._ray_address:
            return None
        return min(self._workers or os.cpu_count() or 1, left)

    def _source(self, name: str, use: CellUse) -> CellSource:
        version = next(row for row in self._store.cell_versions(name) if row.version == use.version)
        return CellSource(name, version.text, version.calibration)

    def _profile(self, use: CellUse) -> tuple[str, bytes] | None:
        row = None if use.profile is None else self._store.profile(use.profile)
        return None if row is None else (row.id, row.document)
