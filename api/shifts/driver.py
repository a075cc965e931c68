"""The driver of jobs: the oldest job of every cell, one at a time, by one instance of the service."""

from __future__ import annotations

import asyncio
import logging

from starlette.concurrency import run_in_threadpool

from api.dependencies import Service
from api.shifts.run import JobRun
from store import JobDriven, JobLost, JobRow, StoreError, new_id

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
        try:
            rows = await run_in_threadpool(self._service.store.unfinished_jobs)
            for row in _oldest_of_cells(rows):
                if row.id not in self._runs and not row.is_driven:
                    claimed = await run_in_threadpool(self._service.store.claim_job, row.id, self._name)
                    self._begin(claimed)
        except (JobDriven, JobLost):  # another instance was quicker, or it was cancelled meanwhile
            pass
        except StoreError:  # the store has logged it
            pass

    def _begin(self, row: JobRow) -> None:
        task = asyncio.create_task(JobRun(self._service, row, self._name).run())
        self._runs[row.id] = task
        task.add_done_callback(lambda done: self._ended(row.id, done))

    def _ended(self, id: str, task: asyncio.Task[None]) -> None:
        del self._runs[id]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("job %s: its driver failed and is started again: %s", id, error, exc_info=error)


def _oldest_of_cells(rows: list[JobRow]) -> list[JobRow]:
    """Returns the first job of every cell."""
    first: dict[str, JobRow] = {}
    for row in rows:
        first.setdefault(row.cell, row)
    return list(first.values())
