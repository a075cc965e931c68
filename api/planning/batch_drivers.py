"""Drivers of the service's batches: one process at a time, begun again where it died, ended with the service."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from starlette.concurrency import run_in_threadpool

from api.planning.child_process import PlanningCommand
from store import BatchRow, Store, StoreError, new_id

IDLE_POLL_S = 2.0  # [s] between two looks for a batch that another instance of the service has queued
BACKOFF_S = 0.5  # [s] times the number of failures before a driver is begun again
FAILURES_MAX = 3  # drivers in a row that end without a result: the batch cannot be planned

log = logging.getLogger("fling")


class BatchDrivers:
    """Has the service's batches planned, the oldest first, by processes of their own (`python -m jobs`).

    Args:
        store: of the batches.
        database_url: of the same.
        workers: Number of planner processes of a driver; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
    """

    def __init__(self, store: Store, database_url: str, workers: int | None, ray_address: str | None) -> None:
        self._store = store
        self._command = PlanningCommand("jobs", database_url, workers, ray_address)
        self._name = f"service {new_id()}"
        self._news = asyncio.Event()
        self._failures: dict[str, int] = {}

    def wake(self) -> None:
        """Makes a batch that was just queued begin at once; called from the event loop."""
        self._news.set()

    async def run(self) -> None:
        """Drives batch after batch until it is cancelled; the driver then stops, and its batch waits for the next."""
        while True:
            row = await self._next()
            if row is None:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), IDLE_POLL_S)
                self._news.clear()
                continue
            await self._drive(row)

    async def _next(self) -> BatchRow | None:
        """Returns the oldest batch that nobody else drives."""
        try:
            rows = await run_in_threadpool(self._store.unfinished_batches, "service")
        except StoreError:  # the store has logged it
            return None
        return next((row for row in rows if not row.is_driven or row.driver_id == self._name), None)

    async def _drive(self, row: BatchRow) -> None:
        status, errors = await self._command.run(row.id, "--driver", self._name)
        if status != 0:
            await self._failed(row, status, errors)

    async def _failed(self, row: BatchRow, status: int, errors: str) -> None:
        """Has a batch begun again whose driver died; gives it up where several did without a result."""
        last_line = errors.rpartition("\n")[2].removeprefix("fling: ")
        reason = last_line or f"its driver ended with status {status}"
        log.warning("batch %s: %s", row.id, reason)
        with suppress(StoreError):  # the next round sees the batch again
            now = await run_in_threadpool(self._store.batch, row.id)
            progressed = now is not None and now.done > row.done
            self._failures[row.id] = 1 if progressed else self._failures.get(row.id, 0) + 1
            if self._failures[row.id] >= FAILURES_MAX:
                del self._failures[row.id]
                await run_in_threadpool(self._store.finish_batch, row.id, "failed", reason)
                return
        await asyncio.sleep(BACKOFF_S * self._failures.get(row.id, 0))
