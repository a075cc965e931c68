"""The driver of jobs: one job of every cell at a time, the oldest first, by one instance of the service."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from starlette.concurrency import run_in_threadpool

from api.dependencies import Service
from api.shifts.run import JobRun
from store import JobDriven, JobLost, JobRow, StoreError, new_id

FAILURES_MAX = 3  # of a job's driver, each a bug: the job stops
LOOK_S = 0.5  # [s] between two looks for jobs that are new, or whose driver has died

log = logging.getLogger("fling")


class JobDrivers:
    """Carries out the jobs that nobody drives.

    Args:
        service: with the store that has them.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._name = f"service {new_id()}"
        self._runs: dict[str, asyncio.Task[None]] = {}
        self._failures: dict[str, list[str]] = {}

    async def run(self) -> None:
        """Carries out jobs until it is cancelled; another driver then goes on with them."""
        try:
            while True:
                await self._begin_all()
                await asyncio.sleep(LOOK_S)
        finally:
            for task in self._runs.values():
                task.cancel()
            await asyncio.gather(*self._runs.values(), return_exceptions=True)

    async def _begin_all(self) -> None:
        with suppress(StoreError):  # the store has logged it
            for row in _next_of_cells(await run_in_threadpool(self._service.store.unfinished_jobs)):
                is_free = not row.is_driven or row.driver_id == self._name
                if is_free and row.id not in self._runs:
                    with suppress(JobDriven, JobLost):  # another instance was quicker, or it was cancelled meanwhile
                        await self._begin(await run_in_threadpool(self._service.store.claim_job, row.id, self._name))

    async def _begin(self, row: JobRow) -> None:
        failures = self._failures.get(row.id, [])
        if len(failures) == FAILURES_MAX:
            del self._failures[row.id]
            reason = f"its driver failed {FAILURES_MAX} times, at last with: {failures[-1]}"
            await run_in_threadpool(self._service.store.finish_job, row.id, self._name, "stopped", reason)
            return
        task = asyncio.create_task(self._carry_out(row))
        self._runs[row.id] = task
        task.add_done_callback(lambda done: self._ended(row.id, done))

    async def _carry_out(self, row: JobRow) -> None:
        await JobRun(self._service, row, self._name).run()

    def _ended(self, id: str, task: asyncio.Task[None]) -> None:
        del self._runs[id]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("job %s: its driver failed: %s", id, error, exc_info=error)
            self._failures.setdefault(id, []).append(f"{type(error).__name__}: {error}")


def _next_of_cells(rows: list[JobRow]) -> list[JobRow]:
    """Returns the first job of every cell: one that has begun goes on before an older one that was resumed."""
    first: dict[str, JobRow] = {}
    for row in sorted(rows, key=lambda row: row.state == "queued"):
        first.setdefault(row.cell, row)
    return list(first.values())
