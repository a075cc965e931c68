"""Drivers of the service's batches: one process at a time, begun again where it died, ended with the service."""

from __future__ import annotations

import asyncio
import logging
import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from typing import IO

from starlette.concurrency import run_in_threadpool

from store import BatchRow, Store, StoreError, new_id

IDLE_POLL_S = 2.0  # [s] between two looks for a batch that another instance of the service has queued
EXIT_POLL_S = 0.2  # [s] between two looks at whether the driver has ended
STOP_S = 10.0  # [s] after which a driver that was asked to stop is killed
BACKOFF_S = 0.5  # [s] times the number of failures before a driver is begun again
FAILURES_MAX = 3  # drivers in a row that end without a result: the batch cannot be planned

log = logging.getLogger("fling")


class BatchDrivers:
    """Has the service's batches planned, the oldest first, by processes of their own (`python -m batch`).

    Args:
        store: of the batches.
        database_url: of the same.
        workers: Number of planner processes of a driver; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
    """

    def __init__(self, store: Store, database_url: str, workers: int | None, ray_address: str | None) -> None:
        self._store = store
        self._environment = {**os.environ, "FLING_DATABASE_URL": database_url}
        self._options = [
            *(["--workers", str(workers)] if workers else []),
            *(["--ray", ray_address] if ray_address else []),
        ]
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
        with tempfile.TemporaryFile() as errors:
            command = [sys.executable, "-P", "-m", "batch", row.id, "--driver", self._name, *self._options]
            process = subprocess.Popen(
                command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
            )
            try:
                while process.poll() is None:
                    await asyncio.sleep(EXIT_POLL_S)
            finally:
                _end(process)
            if process.returncode != 0:
                await self._failed(row, process.returncode, errors)

    async def _failed(self, row: BatchRow, status: int, errors: IO[bytes]) -> None:
        """Has a batch begun again whose driver died; gives it up where several did without a result."""
        reason = _last_line(errors) or f"its driver ended with status {status}"
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


def _end(process: subprocess.Popen[bytes]) -> None:
    """Asks a driver to stop, and sees to it."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _last_line(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read().decode(errors="replace").strip().splitlines()
    return lines[-1].removeprefix("fling: ") if lines else ""
