"""Drivers of the service's batches and maps: one process at a time for each of the two, ended with the service."""

from __future__ import annotations

import asyncio
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass

from starlette.concurrency import run_in_threadpool

from store import Store, StoreError, new_id

IDLE_POLL_S = 2.0  # [s] between two looks for what another instance of the service has queued, or left
EXIT_POLL_S = 0.2  # [s] between two looks at whether the process has ended
STOP_S = 10.0  # [s] after which a process that was asked to stop is killed
BACKOFF_S = 0.5  # [s] times the number of failures, before a driver is started again
FAILURES_MAX = 3  # drivers in a row that end without an answer: what they drive cannot be planned
BEAT_S = 10.0  # [s] between two signs of life of the maps in line

log = logging.getLogger("fling")


@dataclass(frozen=True)
class DriverCommand:
    """`python -m jobs batch ID`, `python -m jobs map ID`.

    Attributes:
        database_url: Of the store that it works on.
        workers: Number of its planner processes; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
    """

    database_url: str
    workers: int | None
    ray_address: str | None

    async def run(self, *arguments: str, meanwhile: Callable[[], Awaitable[None]]) -> tuple[int, str]:
        """Runs it to its end; if the task is cancelled, stops it.

        Args:
            arguments: Of this run.
            meanwhile: Called every `EXIT_POLL_S`.

        Returns:
            Its exit status, and what it wrote to standard error.
        """
        options = ["--workers", str(self.workers)] if self.workers else []
        options += ["--ray", self.ray_address] if self.ray_address else []
        with tempfile.TemporaryFile() as errors:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "jobs", *arguments, *options],
                env={**os.environ, "FLING_DATABASE_URL": self.database_url},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
            )
            try:
                while process.poll() is None:
                    await asyncio.sleep(EXIT_POLL_S)
                    await meanwhile()
            finally:
                _end(process)
            errors.seek(0)
            return process.returncode, errors.read().decode(errors="replace").strip()


class DriverProcesses:
    """Has what the service was asked for planned, the oldest first, by one process after another.

    Args:
        store: of the batches and maps.
        command: starts a driver.
    """

    kind: str

    def __init__(self, store: Store, command: DriverCommand) -> None:
        self._store = store
        self._command = command
        self._name = f"service {new_id()}"
        self._news = asyncio.Event()
        self._failures: dict[str, int] = {}

    async def run(self) -> None:
        """Drives one after another until it is cancelled; the driver then stops, and what it drives waits."""
        while True:
            id = await self._in_thread(self._next)
            if id is None:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), IDLE_POLL_S)
                self._news.clear()
                continue
            await self._drive(id)

    async def _drive(self, id: str) -> None:
        answers = await self._in_thread(self._answers, id)
        status, errors = await self._command.run(self.kind, id, "--driver", self._name, meanwhile=self._meanwhile)
        if status == 0:
            self._failures.pop(id, None)
            return
        reason = errors.rpartition("\n")[2].removeprefix("fling: ") or f"its driver ended with status {status}"
        log.warning("%s %s: %s", self.kind, id, reason)
        has_progressed = (await self._in_thread(self._answers, id) or 0) > (answers or 0)
        self._failures[id] = 1 if has_progressed else self._failures.get(id, 0) + 1
        if self._failures[id] < FAILURES_MAX:
            await asyncio.sleep(BACKOFF_S * self._failures[id])
            return
        del self._failures[id]
        await self._in_thread(self._give_up, id, reason)

    async def _in_thread(self, call: Callable, *arguments: object):  # type: ignore[no-untyped-def,type-arg]
        """Returns what a call of the store answers; None if it cannot be reached, which the store has logged."""
        with suppress(StoreError):
            return await run_in_threadpool(call, *arguments)
        return None

    async def _meanwhile(self) -> None:
        """Called now and then while a driver works."""

    def _next(self) -> str | None:
        """Returns the id of what is driven next, if there is anything."""
        raise NotImplementedError

    def _answers(self, id: str) -> int:
        """Returns how many answers there are."""
        raise NotImplementedError

    def _give_up(self, id: str, reason: str) -> None:
        """Records that it cannot be planned."""
        raise NotImplementedError


class BatchDrivers(DriverProcesses):
    """Has the service's batches planned."""

    kind = "batch"

    def wake(self) -> None:
        """Makes a batch that was just queued begin at once; called from the event loop."""
        self._news.set()

    def _next(self) -> str | None:
        rows = self._store.unfinished_batches("service")
        return next((row.id for row in rows if not row.is_driven or row.driver_id == self._name), None)

    def _answers(self, id: str) -> int:
        row = self._store.batch(id)
        return 0 if row is None else row.done

    def _give_up(self, id: str, reason: str) -> None:
        self._store.finish_batch(id, "failed", reason)


class MapDrivers(DriverProcesses):
    """Has the service's maps made: those in line, then those that nobody works on any more."""

    kind = "map"

    def __init__(self, store: Store, command: DriverCommand) -> None:
        super().__init__(store, command)
        self._line: list[str] = []
        self._beat_at = 0.0

    def add(self, map_id: str) -> None:
        """Puts a map in line, unless it is there already; called from the event loop."""
        if map_id not in self._line:
            self._line.append(map_id)
            self._news.set()

    def _next(self) -> str | None:
        running = {row.id: row for row in self._store.running_maps("service")}
        self._line = [id for id in self._line if id in running]
        if not self._line:
            self._line = [row.id for row in running.values() if not row.is_worked_on]
        return next(iter(self._line), None)

    def _answers(self, id: str) -> int:
        return self._store.landing_cell_count(id)

    def _give_up(self, id: str, reason: str) -> None:
        self._store.end_map(id, "cancelled")

    async def _meanwhile(self) -> None:
        """Says now and then that the maps in line are taken care of."""
        if time.monotonic() - self._beat_at >= BEAT_S:
            self._beat_at = time.monotonic()
            await self._in_thread(self._store.beat_maps, list(self._line))


def _end(process: subprocess.Popen[bytes]) -> None:
    """Stops a process; kills it if it does not stop in time."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
