from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from store import IdempotencyKey, KeyTaken, PlanRow, Store, StoreUnavailable, new_id, split_plan
from tests.store.conftest import TRAJECTORY


def test_a_plan_comes_back_as_it_was_written(store, add_plan):
    row = store.plan(add_plan())
    assert (row.cell, row.cell_sha256, row.backend, row.summary) == ("ur5e-sim", "sha", "ruckig", b'{"id":1}')
    assert json.loads(row.document) == {"id": 1, "trajectory": TRAJECTORY}
    assert split_plan(row.document) == (row.summary, row.samples)
    assert store.plan("nothing") is None


def test_summaries_leave_the_document_out(store, add_plan):
    id = add_plan()
    assert store.plan_summary(id).samples is None
    assert store.plan_summary(id).document == store.plan_summary(id).summary == b'{"id":1}'
    assert store.plan_summary("nothing") is None


def test_lists_are_newest_first_and_page_through_everything_once(store, add_plan):
    ids = [add_plan() for _ in range(7)]
    seen = []
    cursor = None
    for _ in range(10):
        rows, cursor = store.plans(limit=3, cursor=cursor)
        seen += [row.id for row in rows]
        if cursor is None:
            break
    assert seen == sorted(ids, reverse=True)


def test_an_idempotency_key_stands_for_the_first_plan(store):
    key = IdempotencyKey("me /plan", "k", "body")
    first = new_id()
    store.add_plan(PlanRow(first, 1.0, "c", "s", "b", b"{}"), key)
    with pytest.raises(KeyTaken) as caught:
        store.add_plan(PlanRow(new_id(), 1.0, "c", "s", "b", b"{}"), key)
    assert caught.value.resource_id == first
    assert len(store.plans()[0]) == 1


def test_of_many_at_once_with_one_key_one_is_stored(store):
    key = IdempotencyKey("me /plan", "k", "body")

    def attempt(_: int) -> str:
        id = new_id()
        try:
            store.add_plan(PlanRow(id, 1.0, "c", "s", "b", b"{}"), key)
        except KeyTaken as taken:
            return taken.resource_of(key)
        return id

    with ThreadPoolExecutor(8) as pool:
        answered = set(pool.map(attempt, range(24)))
    assert answered == {row.id for row in store.plans()[0]}
    assert len(answered) == 1


def test_a_key_with_another_body_is_refused(store):
    store.add_plan(PlanRow(new_id(), 1.0, "c", "s", "b", b"{}"), IdempotencyKey("me /plan", "k", "body"))
    with pytest.raises(KeyTaken) as caught:
        store.resource_of_key(IdempotencyKey("me /plan", "k", "other body"))
    assert caught.value.body_sha256 == "body"
    assert store.resource_of_key(IdempotencyKey("you /plan", "k", "other body")) is None


def test_ids_sort_by_time_and_are_version_7():
    ids = [new_id() for _ in range(3)]
    assert [id[14] for id in ids] == ["7"] * 3
    assert all(id[19] in "89ab" for id in ids)
    assert len({id[:8] for id in ids}) == 1  # the leading bits are the time


def test_a_closed_store_and_a_missing_table_are_not_reachable(store: Store):
    store.plans(limit=1)
    with store._engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE plans RENAME TO gone")
    with pytest.raises(StoreUnavailable):
        store.plans(limit=1)
