"""A batch that is driven: its requests that have no result, each problem once."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from jobs.batches.specification import BatchSpecification, CellUse, plan_id, problem_sha256
from jobs.planning import PlanningJob
from jobs.pool import JobResult
from jobs.writer import GROUP, LINE, Put
from planner.cell import CellSource
from store import BatchDriven, BatchResultRow, BatchRow, PlanRow, Store

CLAIM_POLL_S = 0.5  # [s] between two attempts to take over a batch whose driver may have died
CLAIM_S = 15.0  # [s] after which it must have been alive


def wait_and_claim(store: Store, batch_id: str, driver_id: str, wait_s: float = CLAIM_S) -> BatchRow:
    """Claims a batch; waits until its former driver counts as dead.

    Raises:
        BatchDriven: Another driver has it, and is alive.
        BatchLost, UnknownRow: It is finished; there is none.
    """
    until = time.monotonic() + wait_s
    while True:
        try:
            return store.claim_batch(batch_id, driver_id)
        except BatchDriven:
            if time.monotonic() > until:
                raise
        time.sleep(CLAIM_POLL_S)


class DrivenBatch:
    """A batch to be driven; see `jobs.driver.Drivable`.

    Args:
        store: of the batch.
        row: the batch, claimed by this driver.
        on_progress: called with the batch whenever results were stored, in another thread.
    """

    def __init__(self, store: Store, row: BatchRow, on_progress: Callable[[BatchRow], None] = lambda row: None) -> None:
        assert row.driver_id is not None  # it has just been claimed
        self._store = store
        self._row = row
        self._driver_id = row.driver_id
        self._on_progress = on_progress
        self._specification = BatchSpecification.stored(store, row.id)
        self._sources = {name: self._source(name, use) for name, use in self._specification.cells.items()}
        self._profiles = {name: self._profile(use) for name, use in self._specification.cells.items()}
        self._given: dict[int, str] = {}  # problem of each job that is being planned
        self._asking: dict[str, list[int]] = {}  # numbers of the requests that ask for it
        self._recent: OrderedDict[str, BatchResultRow] = OrderedDict()  # longer than what waits to be written
        self.left = row.total - row.done
        self.source = next(iter(self._sources.values()))
        self.is_cancelled = row.cancel_requested_at is not None

    def steps(self, put: Put) -> Iterator[Iterator[PlanningJob]]:
        """Yields the jobs of all problems that have no result, as the one step."""
        yield self._jobs(put)

    def answer(self, result: JobResult, put: Put) -> None:
        """Puts the results of all requests for a problem in line."""
        sha256 = self._given.pop(result.number)
        first, *others = self._asking.pop(sha256)
        row = self._result(first, sha256, result)
        put(row, None if result.planned is None else result.planned.row)
        self._remember(row)
        for number in others:
            put(replace(row, number=number), None)

    def save(self, rows: Sequence[BatchResultRow], plans: Sequence[PlanRow]) -> bool:
        """Stores results; returns whether the batch was cancelled."""
        if rows:
            row = self._store.add_batch_results(self._row.id, self._driver_id, rows, plans)
        else:
            row = self._store.beat_batch(self._row.id, self._driver_id)
        self._on_progress(row)
        return row.cancel_requested_at is not None

    def end(self, is_cancelled: bool, is_complete: bool) -> None:
        """Finishes the batch, or puts it back into the queue."""
        row = self._store.batch(self._row.id)
        if row is None:
            return
        if row.done == row.total:
            self._store.finish_batch(self._row.id, "completed")
        elif is_cancelled:
            self._store.finish_batch(self._row.id, "cancelled")
        else:
            self._store.release_batch(self._row.id, self._driver_id)

    def _jobs(self, put: Put) -> Iterator[PlanningJob]:
        """Yields a job for each problem that has no result; a problem that was planned already answers at once."""
        done = bytearray(self._row.total)
        for number in self._store.batch_numbers(self._row.id):
            done[number] = 1
        given = 0
        for number, request in self._specification.numbered():
            if done[number]:
                continue
            source = self._sources[request["cell"]]
            sha256 = problem_sha256(request, source.sha256, self._specification.cells[source.name].profile)
            if sha256 in self._asking:
                self._asking[sha256].append(number)
                continue
            known = self._recent.get(sha256) or self._store.batch_result_of(self._row.id, sha256)
            if known is not None:
                put(replace(known, number=number), None)
                continue
            self._asking[sha256] = [number]
            self._given[given] = sha256
            given += 1
            yield self._job(request, source, sha256)

    def _job(self, request: Mapping[str, Any], source: CellSource, sha256: str) -> PlanningJob:
        return PlanningJob(
            plan_id=plan_id(self._row.id, sha256),
            created_at=time.time(),
            cell=source,
            request=request,
            profile=self._profiles[source.name],
            request_id=self._row.request_id,
            cell_version=self._specification.cells[source.name].version,
        )

    def _result(self, number: int, sha256: str, result: JobResult) -> BatchResultRow:
        """Returns the row of a result."""
        planned = result.planned
        if planned is None:
            refusal = result.refusal or {}
            outcome = str(refusal["name"])
            return BatchResultRow(self._row.id, number, sha256, outcome, result.duration_s, refusal=refusal)
        return BatchResultRow(
            batch_id=self._row.id,
            number=number,
            problem_sha256=sha256,
            outcome="planned",
            planning_time_s=result.duration_s,
            plan_id=planned.row.id,
            trajectory_sha256=planned.samples_sha256,
            release_time_s=planned.release_time_s,
            duration_s=planned.duration_s,
            release_speed_m_s=planned.release_speed_m_s,
            hit_probability=planned.hit_probability,
        )

    def _remember(self, row: BatchResultRow) -> None:
        self._recent[row.problem_sha256] = row
        while len(self._recent) > 2 * (LINE + GROUP):
            self._recent.popitem(last=False)

    def _source(self, name: str, use: CellUse) -> CellSource:
        version = next(row for row in self._store.cell_versions(name) if row.version == use.version)
        return CellSource(name, version.text, version.calibration, version.meshes)

    def _profile(self, use: CellUse) -> tuple[str, bytes] | None:
        row = None if use.profile is None else self._store.profile(use.profile)
        return None if row is None else (row.id, row.document)
