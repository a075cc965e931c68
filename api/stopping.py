"""A client's stop: first to the executor of this machine, which needs no database, then into the store."""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from anyio.to_thread import run_sync

from api.lanes import Lanes
from fling import stop_socket
from store import AuditLine, ExecutionRow, Store, StoreError

LOOK_UP_S = 0.25  # [s] for the store to say which execution is the latest
RECORD_S = 0.4  # [s] for the store to note a stop that the executor has; with the rest an answer comes within a second

Answer = TypeVar("Answer")
log = logging.getLogger("fling")


class Stopping:
    """Stops executions, whatever the database does."""

    def __init__(self, store: Store, data: Path, lanes: Lanes) -> None:
        """Prepares it.

        Args:
            store: keeps the requests.
            data: folder of the executors' files.
            lanes: of the service's threads.
        """
        self._store = store
        self._data = data
        self._lanes = lanes
        self._pending: set[asyncio.Task[Any]] = set()

    async def newest(self) -> str | None:
        """Returns the id of the newest execution; None without one, and where the store does not answer at once."""
        looking = self._in_store(lambda: self._store.latest_execution_id())
        try:
            return await asyncio.wait_for(looking, LOOK_UP_S) or None
        except (TimeoutError, StoreError):
            return None

    async def at_executor(self, id: str | None, who: str) -> ExecutionRow | None:
        """Asks the executors of this machine for the brake of an execution; None: of the newest that runs.

        Returns:
            The execution as its executor knows it; None where no executor runs it.
        """

        def ask() -> dict[str, Any] | None:
            here = self._data
            return stop_socket.stop_newest(here, who) if id is None else stop_socket.stop(here, id, who)

        found = await run_sync(ask, limiter=self._lanes.stops)
        return None if found is None else _row(found)

    async def ended(self, id: str) -> ExecutionRow | None:
        """Returns an execution that has ended; None of any other. It is read, which waits for no writer.

        Raises:
            StoreError: the store does not answer.
        """
        row = await self._in_store(lambda: self._store.execution(id))
        return row if row is not None and row.state == "finished" else None

    async def in_store(self, id: str, audit: AuditLine) -> ExecutionRow:
        """Notes the request in the store, however long that takes.

        Raises:
            StoreError: there is no such execution, or the store does not answer.
        """
        return await self._in_store(lambda: self._store.request_abort(id, audit))

    async def in_store_soon(self, id: str, audit: AuditLine) -> ExecutionRow | None:
        """Notes the request in the store; None where that takes longer, and goes on by itself, or fails."""
        noting = asyncio.create_task(self.in_store(id, audit))
        self._pending.add(noting)
        noting.add_done_callback(lambda task: self._noted(task, audit))
        await asyncio.wait({noting}, timeout=RECORD_S)
        is_noted = noting.done() and noting.exception() is None
        return noting.result() if is_noted else None

    def _noted(self, task: asyncio.Task[ExecutionRow], audit: AuditLine) -> None:
        self._pending.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("a stop is not in the database: %s", error, extra={"fields": vars(audit)})

    async def _in_store(self, call: Callable[[], Answer]) -> Answer:
        return await run_sync(call, limiter=self._lanes.notes, abandon_on_cancel=True)


def _row(told: Mapping[str, Any]) -> ExecutionRow:
    """Returns an execution as its executor tells it, whose version may have other fields than this one."""
    known: dict[str, Any] = {field.name: told.get(field.name) for field in dataclasses.fields(ExecutionRow)}
    return ExecutionRow(**known)
