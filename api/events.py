"""Server-sent events of one execution, read from the store as they come."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

import orjson
from starlette.concurrency import run_in_threadpool

from api.clock import iso
from store import EventRow, Store

POLL_S = 0.02  # [s] looks this often; telemetry is written at 20 Hz or more
KEEP_ALIVE_S = 10.0  # [s] a comment, so that proxies do not close a quiet stream
PAGE = 500  # events read at once


async def follow(store: Store, execution_id: str, after_id: int) -> AsyncIterator[bytes]:
    """Yields every event after `after_id`, until the one that ends the execution."""
    spoke = time.monotonic()
    yield b"retry: 500\n\n"
    while True:
        rows = await run_in_threadpool(store.events, execution_id, after_id, PAGE)
        for row in rows:
            yield encode(row)
            after_id = row.id
        if rows:
            spoke = time.monotonic()
            if any(_is_end(row) for row in rows):
                return
        elif await run_in_threadpool(_has_ended, store, execution_id, after_id):
            return
        elif time.monotonic() - spoke > KEEP_ALIVE_S:
            spoke = time.monotonic()
            yield b": still here\n\n"
        await asyncio.sleep(POLL_S)


def encode(row: EventRow) -> bytes:
    """Returns one event in the format of the HTML standard, section 9.2."""
    data = orjson.dumps({"at": iso(row.at), **row.data})
    return f"id: {row.id}\nevent: {row.kind}\ndata: ".encode() + data + b"\n\n"


def _is_end(row: EventRow) -> bool:
    return row.kind == "state" and row.data.get("state") == "finished"


def _has_ended(store: Store, execution_id: str, after_id: int) -> bool:
    """Whether the last event was seen before: a client that resumes after the end."""
    row = store.execution(execution_id)
    return row is None or (row.state == "finished" and not store.events(execution_id, after_id, 1))
