from __future__ import annotations

import pytest

from store import IdempotencyKey, KeyTaken, new_id


@pytest.fixture
def execution_id(store, add_plan):
    return store.queue_execution(add_plan(), "ur5e-sim").id


def test_landings_come_back_as_they_were_written_oldest_first(store, execution_id):
    first = store.add_landing(new_id(), execution_id, 1.0, "person", "Ada", position=(1, 2.5, 0), std_m=0.003)
    second = store.add_landing(new_id(), execution_id, 2.0, "camera", "Bo", result="edge", radius_m=0.1)
    assert store.landings(execution_id) == [first, second]
    assert store.landing(first.id) == first
    assert (first.position, second.position) == ([1.0, 2.5, 0.0], None)
    assert store.landings("nothing") == []


def test_an_observation_is_never_changed(store, execution_id):
    id = new_id()
    first = store.add_landing(id, execution_id, 1.0, "sim-camera", position=(1, 2, 0), std_m=0.0)
    store.add_landing(id, execution_id, 9.0, "person", "Ada", position=(7, 7, 7), std_m=0.0)
    assert store.landings(execution_id) == [first]


def test_a_key_stands_for_the_first_observation(store, execution_id):
    key = IdempotencyKey("me /landing", "k", "body")
    first = store.add_landing(new_id(), execution_id, 1.0, "person", result="hit", radius_m=0.1, key=key)
    with pytest.raises(KeyTaken) as taken:
        store.add_landing(new_id(), execution_id, 2.0, "person", result="hit", radius_m=0.1, key=key)
    assert taken.value.resource_id == first.id
    assert len(store.landings(execution_id)) == 1
