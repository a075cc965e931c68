"""A plan as a stream of server-sent events: the progress of its search, then the plan, or the problem."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncGenerator, Awaitable, Callable

import orjson
from fastapi import Request, Response

from api.http import ProblemDetails, problem_document, translate
from api.planning import ClientGone
from planner.progress import Observer, Progress

EVENT_S = 0.25  # [s] between two events: as fast as a person reads them
SILENCE_S = 1.0  # [s] after which progress is sent again: proxies keep the connection, and the elapsed time goes on
QUEUED = Progress("queued", 0, None, 0.0)

Make = Callable[[Observer], Awaitable[Response]]


async def plan_events(request: Request, make: Make) -> AsyncGenerator[bytes]:
    """Yields the progress of a search as it goes on, then the plan or the problem. Once closed, the search ends.

    Args:
        request: that asks for the plan.
        make: answers it, and tells an observer of the progress.
    """
    newest = QUEUED

    def observe(progress: Progress) -> None:
        nonlocal newest
        newest = progress

    begun_s = time.monotonic()
    sent: Progress | None = None
    sent_s = begun_s
    count = 0
    making = asyncio.ensure_future(make(observe))
    try:
        while newest is not sent or not making.done():  # what was tried last is told before the end
            now_s = time.monotonic()
            if newest is not sent or now_s - sent_s > SILENCE_S:
                sent = newest
                sent_s = now_s
                count += 1
                yield _event(count, "progress", orjson.dumps({**vars(newest), "elapsed_s": now_s - begun_s}))
            await asyncio.wait((making,), timeout=EVENT_S)
        yield _end(request, making, count + 1)
    finally:
        making.cancel()


def _end(request: Request, made: asyncio.Future[Response], number: int) -> bytes:
    """Returns the last event; nothing where the client has left."""
    error = made.exception()
    if error is None:
        return _event(number, "plan", bytes(made.result().body))
    if isinstance(error, ClientGone) or not isinstance(error, Exception):
        return b""
    problem = translate(error)
    request.state.problem = problem  # for the log
    if problem.name == "internal" and not isinstance(error, ProblemDetails):
        logging.getLogger("fling").error("a bug: %r", error, exc_info=error)
    return _event(number, "problem", orjson.dumps(problem_document(problem, request.url.path)))


def _event(number: int, kind: str, data: bytes) -> bytes:
    return b"id: %d\nevent: %b\ndata: %b\n\n" % (number, kind.encode(), data)
