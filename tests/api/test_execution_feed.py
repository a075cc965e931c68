"""One poller per execution, whatever the number of listeners."""

from __future__ import annotations

import asyncio
from typing import Any

from api.execution_feed import ExecutionFeeds
from store import PlanRow, Store, StoreUnavailable
from tests.waiting import until_true

LISTENERS = 50


class CountingStore:
    """A store that counts its queries, and does not answer the first ones if told so."""

    def __init__(self, store: Store, failures: int = 0) -> None:
        self.store = store
        self.failures = failures
        self.queries = 0

    def events(self, *arguments: Any) -> Any:
        self.queries += 1
        if self.queries <= self.failures:
            raise StoreUnavailable(OSError("gone"))
        return self.store.events(*arguments)

    def execution(self, id: str) -> Any:
        return self.store.execution(id)


def queued(store: Store) -> str:
    store.add_plan(PlanRow("p", 1.0, "c", "s", "b", b"{}"))
    return store.queue_execution("p", "c").id


async def heard(feeds: ExecutionFeeds, id: str, after_id: int = 0) -> bytes:
    return b"".join([chunk async for chunk in feeds.listen(id, after_id)])


def test_many_listeners_hear_everything_from_one_poller(tmp_path):
    store = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    id = queued(store)
    counting = CountingStore(store)

    async def test() -> list[bytes]:
        feeds = ExecutionFeeds(counting)  # type: ignore[arg-type]
        listening = [asyncio.create_task(heard(feeds, id)) for _ in range(LISTENERS)]
        for k in range(5):
            store.add_event(id, "telemetry", {"clock_s": k})
            await asyncio.sleep(0.03)
        late = asyncio.create_task(heard(feeds, id))
        await asyncio.sleep(0.03)
        store.finish_execution(id, "completed")
        return await asyncio.gather(*listening, late)

    texts = asyncio.run(test())
    polled = counting.queries
    assert len({text.replace(b": keep-alive\n\n", b"") for text in texts}) == 1
    assert [texts[0].count(word) for word in (b"event: telemetry", b'"finished"')] == [5, 1]
    ids = [int(line[4:]) for line in texts[0].split(b"\n") if line.startswith(b"id: ")]
    assert ids == [event.id for event in store.events(id)]
    assert polled < LISTENERS  # one query each for all, some ten polls
    store.close()


def test_a_store_that_is_gone_for_a_while_ends_no_stream(tmp_path):
    store = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    id = queued(store)
    store.finish_execution(id, "completed")

    async def test() -> bytes:
        feeds = ExecutionFeeds(CountingStore(store, failures=1))  # type: ignore[arg-type]
        return await heard(feeds, id)

    assert b'"completed"' in asyncio.run(test())
    store.close()


def test_closing_ends_all_streams(tmp_path):
    store = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    id = queued(store)

    async def test() -> bytes:
        feeds = ExecutionFeeds(store)
        listening = asyncio.create_task(heard(feeds, id))
        await until_true(lambda: id in feeds._feeds and feeds._feeds[id][0]._ids)  # until it has read
        feeds.close()
        return await listening + await heard(feeds, id)

    assert asyncio.run(test()).count(b'"queued"') == 1  # the second one came too late
    store.close()
