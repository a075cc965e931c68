from __future__ import annotations

import pytest

from store import IdempotencyKey, KeyTaken, UnknownRow, new_id


def thrown(store, plan_id, experiment_id=None):
    """Returns an execution that has ended."""
    row = store.queue_execution(plan_id, "ur5e-sim", experiment_id=experiment_id)
    store.finish_execution(row.id, "completed")
    return row.id


def test_an_experiment_has_the_executions_that_name_it(store, add_plan):
    one, other = (store.add_experiment(name, "Ada", {"repeat": 2}) for name in ("one", "other"))
    first_plan = add_plan()
    second_plan = add_plan()
    ids = [thrown(store, plan, one.id) for plan in (first_plan, second_plan, first_plan)]
    apart = thrown(store, second_plan, other.id)
    alone = thrown(store, first_plan)
    for id in (*ids, apart, alone):
        store.add_landing(new_id(), id, 1.0, "person", result="hit", radius_m=0.1)
    assert [row.id for row in store.executions_of_experiment(one.id)] == ids
    assert [row.execution_id for row in store.landings_of_experiment(one.id)] == ids
    assert {row.id for row in store.plans_of_experiment(one.id)} == {first_plan, second_plan}
    assert store.experiment(one.id) == one
    assert (one.name, one.created_by, one.settings) == ("one", "Ada", {"repeat": 2})
    rows, cursor = store.experiments(limit=1)
    assert (rows, store.experiments(limit=1, cursor=cursor)) == ([other], ([one], None))
    assert store.execution(alone).experiment_id is None


def test_an_unknown_experiment_gets_no_execution(store, add_plan):
    with pytest.raises(UnknownRow):
        store.queue_execution(add_plan(), "ur5e-sim", experiment_id="nothing")
    assert store.executions()[0] == []


def test_a_key_stands_for_the_first_experiment(store):
    key = IdempotencyKey("me /experiments", "k", "body")
    first = store.add_experiment("", "", {}, key)
    with pytest.raises(KeyTaken) as taken:
        store.add_experiment("", "", {}, key)
    assert taken.value.resource_id == first.id
