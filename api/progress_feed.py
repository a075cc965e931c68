"""Server-sent events of what goes on in the store: its progress whenever that has changed, up to its end."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Callable
from typing import Any, NamedTuple

import orjson
from fastapi import Request
from starlette.concurrency import run_in_threadpool

from store import StoreUnavailable

POLL_S = 0.5  # [s] between two looks at the progress
KEEP_ALIVE_S = 10.0  # [s] silence before a comment is sent, so that proxies keep the connection


class ProgressSeen(NamedTuple):
    """What a look at the store shows.

    Attributes:
        number: grows with every change; the id of the event.
        document: the data of the event.
        is_over: whether nothing changes any more.
    """

    number: int
    document: dict[str, Any]
    is_over: bool


async def progress_events(
    request: Request, look: Callable[[], ProgressSeen | None], after: int
) -> AsyncGenerator[bytes]:
    """Yields the progress whenever it has changed, up to its end or the service's.

    Args:
        request: of the client.
        look: returns what the store shows; None where there is nothing. Called in a thread.
        after: number of the event that the client has seen last.
    """
    yield b"retry: 500\n\n"
    last = after
    sent_at = time.monotonic()
    while not request.app.state.is_draining:
        try:
            seen = await run_in_threadpool(look)
        except StoreUnavailable:
            seen = None
        if seen is not None and (seen.number > last or seen.is_over):
            last = seen.number
            sent_at = time.monotonic()
            yield f"id: {last}\nevent: progress\ndata: ".encode() + orjson.dumps(seen.document) + b"\n\n"
        if seen is not None and seen.is_over:
            return
        if time.monotonic() - sent_at > KEEP_ALIVE_S:
            sent_at = time.monotonic()
            yield b": keep-alive\n\n"
        await asyncio.sleep(POLL_S)
