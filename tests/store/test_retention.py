from __future__ import annotations

import time

import pytest

from store import IdempotencyKey, KeyTaken, PlanRow, Retention, Store, new_id, pack_samples
from store.retention import BATCH, DAY_S

LONG_AGO = time.time() - 10 * DAY_S


def add_plans(store: Store, count: int, at: float = LONG_AGO) -> list[str]:
    ids = [new_id() for _ in range(count)]
    for k, id in enumerate(ids):
        store.add_plan(PlanRow(id, at + k, "c", "s", "b", b"{}"))
    return ids


def run(store: Store, plan_id: str, experiment_id: str | None = None) -> str:
    id = store.queue_execution(plan_id, "c", experiment_id=experiment_id).id
    store.add_recording(id, b"mcap", pack_samples(["t"], [[0.0]]))
    store.add_landing(new_id(), id, 1.0, "person", position=[1.0, 0.0, 0.0], std_m=0.01)
    store.finish_execution(id, "completed")
    return id


def plans_of(store: Store) -> set[str]:
    return {row.id for row in store.plans(200)[0]}


def test_nothing_is_deleted_by_default(store):
    add_plans(store, 3)
    assert store.retain(Retention()) == (0, 0)
    assert len(plans_of(store)) == 3


def test_the_newest_plans_are_kept(store):
    ids = add_plans(store, BATCH + 5)
    assert store.retain(Retention(plans=3)) == (BATCH + 2, 0)
    assert plans_of(store) == set(sorted(ids)[-3:])  # ids of one millisecond are in no order of their own


def test_plans_are_kept_for_their_time(store):
    old = add_plans(store, 2)
    young = add_plans(store, 2, time.time() - 2 * DAY_S)
    assert store.retain(Retention(plans_days=5.0)) == (2, 0)
    assert plans_of(store) == set(young)
    assert not plans_of(store) & set(old)


def test_a_plan_in_use_or_just_made_is_kept(store):
    used, waiting, unused = add_plans(store, 3)
    fresh = add_plans(store, 1, time.time())
    run(store, used)
    store.queue_execution(waiting, "other")
    assert store.retain(Retention(plans=1, plans_days=0.001)) == (1, 0)
    assert plans_of(store) == {used, waiting, *fresh}
    assert unused not in plans_of(store)


def test_executions_go_with_everything_that_belongs_to_them_and_then_their_plans(store):
    first, second = add_plans(store, 2)
    old = run(store, first)
    new = run(store, second)
    assert store.retain(Retention(executions=1, plans_days=1.0)) == (1, 1)
    assert (store.execution(old), store.recording(old)) == (None, None)
    assert (store.events(old), store.landings(old)) == ([], [])
    assert store.execution(new) is not None
    assert store.recording(new) is not None
    assert plans_of(store) == {second}


def test_an_open_execution_and_those_of_an_experiment_are_kept(store):
    (plan_id,) = add_plans(store, 1)
    thrown = run(store, plan_id, store.add_experiment("e", "me", {}).id)
    open_one = store.queue_execution(plan_id, "c").id
    assert store.retain(Retention(executions=1, executions_days=1e-9)) == (0, 0)
    assert {row.id for row in store.executions()[0]} == {thrown, open_one}


def test_a_key_goes_with_its_plan(store):
    key = IdempotencyKey("me /plan", "k", "body")
    store.add_plan(PlanRow(new_id(), LONG_AGO, "c", "s", "b", b"{}"), key)
    with pytest.raises(KeyTaken):
        store.add_plan(PlanRow(new_id(), LONG_AGO, "c", "s", "b", b"{}"), key)
    store.retain(Retention(plans_days=1.0))
    assert store.resource_of_key(key) is None
    store.add_plan(PlanRow(new_id(), LONG_AGO, "c", "s", "b", b"{}"), key)
