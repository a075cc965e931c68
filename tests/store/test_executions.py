from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from store import CellBusy, IdempotencyKey, KeyTaken, Store, UnknownRow, pack_samples


@pytest.fixture
def queued(store, add_plan):
    assert store.take_cell("ur5e-sim", "x", "sim", "a test")
    return store.queue_execution(add_plan(), "ur5e-sim", "speedj", False, "me")


def states(store: Store, id: str) -> list[str]:
    return [event.data["state"] for event in store.events(id) if event.kind == "state"]


def test_one_execution_a_cell_at_a_time(store, add_plan, queued):
    plan_id = add_plan()
    with pytest.raises(CellBusy):
        store.queue_execution(plan_id, "ur5e-sim")
    store.queue_execution(plan_id, "other-cell")
    store.finish_execution(queued.id, "completed")
    assert store.queue_execution(plan_id, "ur5e-sim").state == "queued"


def test_of_many_at_once_one_is_queued(store, add_plan):
    plan_id = add_plan()

    def attempt(_: int) -> bool:
        try:
            store.queue_execution(plan_id, "ur5e-sim")
        except CellBusy:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(attempt, range(16))) == 1


def test_of_many_executors_one_takes_the_cell_and_claims(database_url, store, add_plan):
    id = store.queue_execution(add_plan(), "ur5e-sim").id

    def attempt(k: int) -> tuple[bool, bool]:
        other = Store.open(database_url)
        try:
            holds = other.take_cell("ur5e-sim", f"executor-{k}", "sim", "a test")
            return holds, other.claim_execution("ur5e-sim", f"executor-{k}") is not None
        finally:
            other.close()

    with ThreadPoolExecutor(8) as pool:
        tried = list(pool.map(attempt, range(8)))
    assert sorted(tried)[-1] == (True, True)
    assert sum(holds for holds, _ in tried) == sum(claims for _, claims in tried) == 1
    claimed = store.execution(id)
    assert claimed.state == "preparing"
    assert claimed.executor_id == store.cell_status("ur5e-sim").executor_id
    assert claimed.claimed_at is not None


def test_only_the_executor_of_the_cell_claims(store, queued):
    seen = store.cell_status("ur5e-sim")
    assert store.take_cell("ur5e-sim", "next", "sim", "a test", seen)
    assert store.claim_execution("ur5e-sim", "x") is None  # the one of before, after a long sleep
    assert store.claim_execution("ur5e-sim", "next").id == queued.id


def test_a_claim_whose_answer_was_lost_is_claimed_again_by_its_executor_alone(store, queued):
    store.claim_execution("ur5e-sim", "x")
    assert store.claim_execution("ur5e-sim", "x").id == queued.id
    assert states(store, queued.id) == ["queued", "preparing"]
    seen = store.cell_status("ur5e-sim")
    assert store.take_cell("ur5e-sim", "next", "sim", "a test", seen)
    assert store.claim_execution("ur5e-sim", "x") is None
    assert store.claim_execution("ur5e-sim", "next") is None


def test_what_has_begun_is_not_claimed_again(store, queued):
    store.claim_execution("ur5e-sim", "x")
    store.set_state(queued.id, "approaching")
    assert store.claim_execution("ur5e-sim", "x") is None


def test_nothing_to_claim(store, queued):
    assert store.claim_execution("other-cell", "x") is None
    store.finish_execution(queued.id, "completed")
    assert store.claim_execution("ur5e-sim", "x") is None


def test_states_and_telemetry_become_events_in_order(store, queued):
    store.claim_execution("ur5e-sim", "x")
    assert store.set_state(queued.id, "streaming", {"why": "because"})
    assert not store.set_state(queued.id, "streaming")
    store.add_event(queued.id, "telemetry", {"q": [0.0] * 6})
    store.finish_execution(queued.id, "completed", metrics={"ticks": 3})
    assert states(store, queued.id) == ["queued", "preparing", "streaming", "finished"]
    every = store.events(queued.id)
    assert [e.id for e in every] == sorted(e.id for e in every)
    assert [e.kind for e in store.events(queued.id, after_id=every[2].id)] == ["telemetry", "state"]
    assert len(store.events(queued.id, limit=2)) == 2


def test_finished_is_final(store, queued):
    assert store.finish_execution(queued.id, "late", "too many missed ticks", {"missed_ticks": 11})
    assert not store.finish_execution(queued.id, "completed")
    assert not store.set_state(queued.id, "streaming")
    row = store.execution(queued.id)
    assert (row.state, row.outcome, row.reason, row.metrics) == (
        "finished",
        "late",
        "too many missed ticks",
        {"missed_ticks": 11},
    )


def test_abort_before_anyone_claimed_ends_it(store, queued):
    row = store.request_abort(queued.id)
    assert (row.state, row.outcome) == ("finished", "aborted")
    assert store.claim_execution("ur5e-sim", "x") is None


def test_abort_of_a_running_one_is_a_request_and_asking_twice_changes_nothing(store, queued):
    store.claim_execution("ur5e-sim", "x")
    assert not store.abort_requested(queued.id)
    first = store.request_abort(queued.id)
    assert store.abort_requested(queued.id)
    assert first.state == "preparing"
    assert store.request_abort(queued.id) == first


def test_abort_of_a_finished_one_leaves_it(store, queued):
    store.finish_execution(queued.id, "completed")
    assert store.request_abort(queued.id).abort_requested_at is None
    with pytest.raises(UnknownRow):
        store.request_abort("nothing")


def test_a_new_daemon_closes_what_an_earlier_one_left(store, add_plan, queued):
    other = store.queue_execution(add_plan("b"), "b")
    assert store.close_open_executions("ur5e-sim", reason="restarted") == [queued.id]
    assert store.execution(queued.id).outcome == "executor_lost"
    assert store.execution(other.id).state == "queued"
    assert store.close_open_executions("ur5e-sim") == []


def test_a_key_is_not_spent_by_a_refused_execution(store, add_plan, queued):
    key = IdempotencyKey("me /execute", "k", "body")
    plan_id = add_plan()
    with pytest.raises(CellBusy):
        store.queue_execution(plan_id, "ur5e-sim", key=key)
    assert store.resource_of_key(key) is None
    store.finish_execution(queued.id, "completed")
    made = store.queue_execution(plan_id, "ur5e-sim", key=key)
    with pytest.raises(KeyTaken) as caught:
        store.queue_execution(plan_id, "ur5e-sim", key=key)
    assert caught.value.resource_id == made.id == store.resource_of_key(key)


def test_of_many_at_once_with_one_key_one_is_queued(store, add_plan):
    key = IdempotencyKey("me /execute", "k", "body")
    plan_id = add_plan()

    def attempt(_: int) -> str:
        try:
            return store.queue_execution(plan_id, "ur5e-sim", key=key).id
        except KeyTaken as taken:
            return taken.resource_of(key)

    with ThreadPoolExecutor(8) as pool:
        answered = set(pool.map(attempt, range(24)))
    assert answered == {row.id for row in store.executions()[0]}
    assert len(answered) == 1


def test_recordings_lists_and_counts(store, add_plan, queued):
    assert store.recording(queued.id) is None
    store.add_recording(queued.id, b"mcap", pack_samples(["t"], [[1.0]]))
    store.add_recording(queued.id, b"mcap", pack_samples(["t"], [[2.5]]))
    assert store.recording(queued.id).csv == b"t\n2.5\n"
    store.finish_execution(queued.id, "completed")
    second = store.queue_execution(queued.plan_id, "ur5e-sim")
    assert [row.id for row in store.open_executions()] == [second.id] == [store.latest_execution_id()]
    assert [row.id for row in store.executions_after(queued.id)] == [second.id]
    assert len(store.executions_after("")) == 2
    rows, cursor = store.executions(limit=1)
    assert {rows[0].id} | {r.id for r in store.executions(cursor=cursor)[0]} == {queued.id, second.id}


def test_an_execution_needs_its_plan(store):
    with pytest.raises(UnknownRow):
        store.queue_execution("no such plan", "ur5e-sim")
