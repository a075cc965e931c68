"""Runners of the service's maps: one process at a time; one that dies or is killed loses next to nothing."""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import suppress

from starlette.concurrency import run_in_threadpool

from api.planning.child_process import PlanningCommand
from store import Store, StoreError

IDLE_POLL_S = 5.0  # [s] between two looks for a map whose service ended before it did
BEAT_S = 10.0  # [s] between two signs of life of the maps in line

log = logging.getLogger("fling")


class MapRunners:
    """Has the service's maps made, one after another, by processes of their own (`python -m jobs.maps`).

    Args:
        store: of the maps.
        database_url: of the same.
        workers: Number of planner processes of a runner; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
    """

    def __init__(self, store: Store, database_url: str, workers: int | None, ray_address: str | None) -> None:
        self._store = store
        self._command = PlanningCommand("jobs.maps", database_url, workers, ray_address)
        self._beat_at = 0.0
        self._in_line: list[str] = []
        self._in_hand = ""
        self._news = asyncio.Event()

    def add(self, map_id: str) -> None:
        """Puts a map in line, unless it is there already; called from the event loop."""
        if map_id not in (self._in_hand, *self._in_line):
            self._in_line.append(map_id)
            self._news.set()

    async def run(self) -> None:
        """Makes map after map until it is cancelled; the map in hand goes on when a service starts again."""
        while True:
            if not self._in_line:
                await self._take_up()
            if self._in_line:
                self._in_hand = self._in_line.pop(0)
                await self._make(self._in_hand)
                self._in_hand = ""
                continue
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), IDLE_POLL_S)
            self._news.clear()

    async def _take_up(self) -> None:
        """Puts those maps of the service in line that nobody works on."""
        with suppress(StoreError):  # the store has logged it
            rows = await run_in_threadpool(self._store.running_maps, "service")
            self._in_line += [row.id for row in rows if not row.is_worked_on]

    async def _make(self, map_id: str) -> None:
        self._beat_at = time.monotonic()
        status, errors = await self._command.run(map_id, meanwhile=self._keep_alive)
        if status != 0:
            log.warning("map %s: %s", map_id, errors[-500:])
            with suppress(StoreError):
                await run_in_threadpool(self._store.end_map, map_id, "cancelled")

    async def _keep_alive(self) -> None:
        """Says now and then that the maps in line are taken care of."""
        if time.monotonic() - self._beat_at >= BEAT_S:
            self._beat_at = time.monotonic()
            with suppress(StoreError):
                await run_in_threadpool(self._store.beat_maps, list(self._in_line))
