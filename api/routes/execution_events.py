"""Events of an execution as server-sent events, read from the store as they are written."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Annotated

import orjson
from fastapi import APIRouter, Header
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from api.dependencies import AnyCaller, ServiceDep
from api.http import problem_answers
from api.routes.executions import ExecutionId, find_execution
from api.schemas import iso_time
from store import EventRow, Store

router = APIRouter(tags=["executions"])

POLL_S = 0.02  # [s] telemetry is written at 20 Hz or more
KEEP_ALIVE_S = 10.0  # [s] silence before a comment is sent, so that proxies keep the connection
PAGE = 500  # events read at once
EVENT_STREAM_ANSWER = {
    "content": {"text/event-stream": {"schema": {"type": "string"}}},
    "description": "Events `state` (data: `StateEvent`) and `telemetry` (`TelemetryEvent`); ends with the execution.",
}


@router.get(
    "/executions/{id}/events",
    summary="Watch an execution",
    responses={200: EVENT_STREAM_ANSWER, **problem_answers("not-found", "invalid-request")},
)
async def watch_execution(
    id: ExecutionId,
    service: ServiceDep,
    caller: AnyCaller,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Resume after this event.")] = 0,
) -> StreamingResponse:
    """Streams state changes and telemetry (20 Hz or more) as server-sent events until the execution has ended."""
    row = await run_in_threadpool(find_execution, service, id)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_stream(service.store, row.id, last_event_id), 200, headers, "text/event-stream")


async def _stream(store: Store, execution_id: str, after_id: int) -> AsyncIterator[bytes]:
    """Yields every event after `after_id`, up to the one that ends the execution."""
    sent_at = time.monotonic()
    yield b"retry: 500\n\n"
    while True:
        rows = await run_in_threadpool(store.events, execution_id, after_id, PAGE)
        for row in rows:
            yield _encode(row)
            after_id = row.id
        if rows:
            sent_at = time.monotonic()
            if any(_is_end(row) for row in rows):
                return
        elif await run_in_threadpool(_has_ended, store, execution_id, after_id):
            return
        elif time.monotonic() - sent_at > KEEP_ALIVE_S:
            sent_at = time.monotonic()
            yield b": keep-alive\n\n"
        await asyncio.sleep(POLL_S)


def _encode(row: EventRow) -> bytes:
    """Returns one event in the format of the HTML standard, section 9.2."""
    data = orjson.dumps({"at": iso_time(row.at), **row.data})
    return f"id: {row.id}\nevent: {row.kind}\ndata: ".encode() + data + b"\n\n"


def _is_end(row: EventRow) -> bool:
    return row.kind == "state" and row.data.get("state") == "finished"


def _has_ended(store: Store, execution_id: str, after_id: int) -> bool:
    """Returns whether the final event was sent before: a client that resumes after the end."""
    row = store.execution(execution_id)
    return row is None or (row.state == "finished" and not store.events(execution_id, after_id, 1))
