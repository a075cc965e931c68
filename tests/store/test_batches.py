from __future__ import annotations

import time
from typing import Any

import pytest
from sqlalchemy import update

from store import (
    BatchDriven,
    BatchLost,
    BatchResultRow,
    IdempotencyKey,
    KeyTaken,
    PlanRow,
    Retention,
    Store,
    UnknownRow,
    new_id,
)
from store.retention import DAY_S, RESULTS
from store.rows import DRIVER_FRESH_S
from store.tables import batches, plans


def result(batch_id: str, number: int, outcome: str = "planned", **fields: Any) -> BatchResultRow:
    return BatchResultRow(batch_id, number, f"sha-{number}", outcome, 0.1, **fields)


def plan(id: str, summary: bytes = b"{}") -> PlanRow:
    return PlanRow(id, time.time() - DAY_S, "c", "s", "b", summary, samples=b"samples")


def running(store: Store, total: int = 3, driver: str = "one") -> str:
    id = store.add_batch(b"specification", total).id
    store.claim_batch(id, driver)
    return id


def rewrite(store: Store, table: Any, id: str, **values: Any) -> None:
    with store._engine.begin() as connection:
        connection.execute(update(table).where(table.c.id == id).values(**values))


def fall_silent(store: Store, id: str) -> None:
    rewrite(store, batches, id, heartbeat_at=time.time() - 2 * DRIVER_FRESH_S)


def test_a_batch_is_queued_claimed_and_finished(store):
    row = store.add_batch(b"specification", 3, "somebody", "service")
    assert (row.state, row.total, row.done, row.counts) == ("queued", 3, 0, {})
    assert store.batch(row.id, whole=True).specification == b"specification"
    assert [open.id for open in store.unfinished_batches("service")] == [row.id]
    assert store.unfinished_batches("command") == []
    claimed = store.claim_batch(row.id, "one")
    assert (claimed.state, claimed.driver_id, claimed.is_driven) == ("running", "one", True)
    assert store.finish_batch(row.id, "completed")
    assert not store.finish_batch(row.id, "cancelled")
    assert store.batch(row.id).outcome == "completed"
    assert store.unfinished_batches("service") == []
    with pytest.raises(BatchLost, match="finished"):
        store.claim_batch(row.id, "one")


def test_the_same_key_makes_one_batch(store):
    key = IdempotencyKey("scope", "key", "body")
    first = store.add_batch(b"", 1, key=key)
    with pytest.raises(KeyTaken) as taken:
        store.add_batch(b"", 1, key=key)
    assert taken.value.resource_of(key) == first.id


def test_one_driver_at_a_time(store):
    id = running(store)
    with pytest.raises(BatchDriven, match="by one"):
        store.claim_batch(id, "two")
    assert store.claim_batch(id, "one").driver_id == "one"  # its own, begun anew
    fall_silent(store, id)
    assert store.claim_batch(id, "two").driver_id == "two"
    for write in (
        lambda: store.beat_batch(id, "one"),
        lambda: store.release_batch(id, "one"),
        lambda: store.add_batch_results(id, "one", [result(id, 0)], []),
    ):
        with pytest.raises(BatchLost):
            write()
    assert store.batch(id).done == 0


def test_results_are_written_once_with_their_plans(store):
    id = running(store)
    made = new_id()
    row = store.add_batch_results(id, "one", [result(id, 0, plan_id=made), result(id, 1, "infeasible")], [plan(made)])
    assert row.counts == {"planned": 1, "infeasible": 1}
    again = [result(id, 0, "infeasible"), result(id, 2, plan_id=made)]
    row = store.add_batch_results(id, "one", again, [plan(made, b"another")])
    assert row.counts == {"planned": 2, "infeasible": 1}
    assert [(one.number, one.outcome) for one in store.batch_results(id)[0]] == [
        (0, "planned"),
        (1, "infeasible"),
        (2, "planned"),
    ]
    assert store.plan(made).summary == b"{}"
    assert store.plan(made).samples == b"samples"
    assert list(store.batch_numbers(id)) == [0, 1, 2]
    assert store.batch_result_of(id, "sha-1").number == 1
    assert store.batch_result_of(id, "sha-9") is None


def test_a_plan_and_its_result_are_stored_together_or_not_at_all(store):
    id = running(store)
    made = new_id()
    broken = result(id, 0, plan_id=made, refusal=object())  # cannot be JSON
    with pytest.raises(Exception, match="serializable"):
        store.add_batch_results(id, "one", [broken], [plan(made)])
    assert store.plan(made) is None
    assert store.batch(id).counts == {}


def test_results_are_read_in_pages(store):
    id = running(store, 5)
    store.add_batch_results(id, "one", [result(id, number) for number in (4, 0, 2, 1, 3)], [])
    pages = []
    after = -1
    while after is not None:
        rows, after = store.batch_results(id, 2, after)
        pages.append([row.number for row in rows])
    assert pages == [[0, 1], [2, 3], [4]]


def test_cancelling_is_for_the_driver_unless_there_is_none(store):
    id = running(store)
    assert store.cancel_batch(id).state == "running"
    assert store.beat_batch(id, "one").cancel_requested_at is not None
    waiting = store.add_batch(b"", 1).id
    assert store.cancel_batch(waiting).outcome == "cancelled"
    dead = running(store)
    fall_silent(store, dead)
    assert store.cancel_batch(dead).outcome == "cancelled"
    with pytest.raises(UnknownRow):
        store.cancel_batch(new_id())


def test_a_released_batch_is_free_for_the_next_driver(store):
    id = running(store)
    store.add_batch_results(id, "one", [result(id, 0)], [])
    store.release_batch(id, "one")
    assert store.batch(id).state == "queued"
    taken = store.claim_batch(id, "two")
    assert taken.started_done == 1


def test_a_plan_stays_as_long_as_its_batch(store):
    id = running(store, RESULTS + 5)
    made = new_id()
    store.add_batch_results(id, "one", [result(id, n, plan_id=made) for n in range(RESULTS + 5)], [plan(made)])
    rewrite(store, plans, made, created_at=1.0)
    rewrite(store, batches, id, created_at=1.0)
    keep = Retention(plans_days=1.0, batches_days=1.0)
    assert store.retain(keep) == (0, 0)
    assert store.retain_batches(keep) == 0  # it is not finished
    store.finish_batch(id, "completed")
    assert store.retain_batches(keep) == 1
    assert store.batch(id) is None
    assert list(store.batch_numbers(id)) == []
    assert store.retain(keep) == (1, 0)
