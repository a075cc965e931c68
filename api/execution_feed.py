"""Events of executions for many listeners: one poller per execution reads the store, however many listen.

Each event is read and encoded once. A listener receives what is new at each poll in one piece.
"""

from __future__ import annotations

import asyncio
import time
from bisect import bisect_right
from collections.abc import AsyncGenerator
from contextlib import aclosing

import orjson
from starlette.concurrency import run_in_threadpool

from api.schemas import iso_time
from store import EventRow, Store, StoreUnavailable

POLL_S = 0.02  # [s] telemetry is written at 20 Hz or more
LISTENER_S = 0.0004  # [s] added for each listener: sending takes 0.1 ms each, and other requests want their turn
OUTAGE_POLL_S = 0.5  # [s] between two attempts while the database does not answer
KEEP_ALIVE_S = 10.0  # [s] silence before a comment is sent, so that proxies keep the connection
PAGE = 500  # events read at once
OPENING = b"retry: 500\n\n"
KEEP_ALIVE = b": keep-alive\n\n"


class ExecutionFeed:
    """The events of one execution from its first one, as server-sent events; `run` polls until the last one.

    Attributes:
        listeners: Number of those who listen.
        has_ended: Whether no further event will come.
    """

    def __init__(self, store: Store, execution_id: str) -> None:
        self._store = store
        self._execution_id = execution_id
        self._ids: list[int] = []
        self._encoded: list[bytes] = []
        self._news = asyncio.Event()  # replaced whenever it is set
        self._announced_at = time.monotonic()
        self.listeners = 0
        self.has_ended = False

    async def run(self) -> None:
        """Polls the store until the execution has ended and its last event is read."""
        try:
            while not self.has_ended:
                await asyncio.sleep(await self._poll())
                if time.monotonic() - self._announced_at > KEEP_ALIVE_S:
                    self._announce()
        finally:
            self.end()

    def end(self) -> None:
        """Ends the streams of all listeners after what was read."""
        self.has_ended = True
        self._announce()

    async def listen(self, after_id: int) -> AsyncGenerator[bytes]:
        """Yields every event after `after_id`, and comments in silence, until the feed has ended."""
        at = bisect_right(self._ids, after_id)
        yield OPENING
        while True:
            news = self._news
            ended = self.has_ended
            chunk, at = self._since(at, after_id)
            if chunk:
                yield chunk
            elif ended:
                return
            else:
                await news.wait()
                if at == len(self._ids) and not self.has_ended:
                    yield KEEP_ALIVE

    def _since(self, at: int, after_id: int) -> tuple[bytes, int]:
        """Returns the events from number `at` on that follow event `after_id`, and the number of the next one."""
        first = max(at, bisect_right(self._ids, after_id))
        return b"".join(self._encoded[first:]), len(self._ids)

    async def _poll(self) -> float:
        """Reads what is new; returns the time until the next poll [s]."""
        last = self._ids[-1] if self._ids else 0
        try:
            rows = await run_in_threadpool(self._store.events, self._execution_id, last, PAGE)
            is_over = not rows and await run_in_threadpool(self._is_over, last)
        except StoreUnavailable:
            return OUTAGE_POLL_S
        self._ids += [row.id for row in rows]
        self._encoded += [_encode(row) for row in rows]
        self.has_ended = self.has_ended or is_over or any(_is_end(row) for row in rows)
        if rows:
            self._announce()
        return 0.0 if len(rows) == PAGE else POLL_S + LISTENER_S * self.listeners

    def _is_over(self, last_id: int) -> bool:
        """Returns whether the execution is gone, or finished with no event left to read."""
        row = self._store.execution(self._execution_id)
        return row is None or (row.state == "finished" and not self._store.events(self._execution_id, last_id, 1))

    def _announce(self) -> None:
        self._announced_at = time.monotonic()
        self._news.set()
        self._news = asyncio.Event()


class ExecutionFeeds:
    """One feed for each execution that somebody listens to."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._feeds: dict[str, tuple[ExecutionFeed, asyncio.Task[None]]] = {}
        self._is_closed = False

    async def listen(self, execution_id: str, after_id: int) -> AsyncGenerator[bytes]:
        """Yields the events of an execution after `after_id` as server-sent events, up to its last one."""
        feed = self._feed(execution_id)
        feed.listeners += 1
        try:
            async with aclosing(feed.listen(after_id)) as chunks:
                async for chunk in chunks:
                    yield chunk
        finally:
            feed.listeners -= 1
            if feed.listeners == 0:
                self._drop(execution_id, feed)

    def close(self) -> None:
        """Ends all streams in order, and those that begin from now on at once; clients resume with `Last-Event-ID`."""
        self._is_closed = True
        for feed, _ in self._feeds.values():
            feed.end()

    def _feed(self, execution_id: str) -> ExecutionFeed:
        if execution_id not in self._feeds:
            feed = ExecutionFeed(self._store, execution_id)
            feed.has_ended = self._is_closed
            self._feeds[execution_id] = feed, asyncio.create_task(feed.run())
        return self._feeds[execution_id][0]

    def _drop(self, execution_id: str, feed: ExecutionFeed) -> None:
        kept = self._feeds.get(execution_id)
        if kept is not None and kept[0] is feed:
            kept[1].cancel()
            del self._feeds[execution_id]


def _encode(row: EventRow) -> bytes:
    """Returns one event in the format of the HTML standard, section 9.2."""
    data = orjson.dumps({"at": iso_time(row.at), **row.data})
    return f"id: {row.id}\nevent: {row.kind}\ndata: ".encode() + data + b"\n\n"


def _is_end(row: EventRow) -> bool:
    return row.kind == "state" and row.data.get("state") == "finished"
