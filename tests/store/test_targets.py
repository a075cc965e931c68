from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from store import IdempotencyKey, KeyTaken, Store, UnknownRow, targets


def test_targets_come_back_as_they_were_written_newest_first(store):
    first = store.add_target("one", {"count": 1}, "Ada")
    second = store.add_target("one", {"count": 1.5})
    store.add_target("other", {"count": 9})
    assert store.targets_of_cell("one") == [second, first]
    assert store.target("one", first.id) == first
    with pytest.raises(UnknownRow, match="tracks no target"):
        store.target("other", first.id)


def test_it_is_there_when_the_database_is_opened_again(store, database_url):
    row = store.add_target("one", {"count": 1})
    changed = store.change_target("one", row.id, lambda track: {"count": track["count"] + 1})
    again = Store.open(database_url)
    try:
        assert again.target("one", row.id) == changed
        assert changed.track == {"count": 2}
    finally:
        again.close()


def test_of_observations_at_once_none_is_lost(store):
    row = store.add_target("one", {"count": 0})

    def observe(_: int) -> None:
        store.change_target("one", row.id, lambda track: {"count": track["count"] + 1})

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(observe, range(40)))
    assert store.target("one", row.id).track == {"count": 40}


OBSERVER = """
import sys
from store import Store
store = Store.open(sys.argv[1])
while True:
    row = store.change_target("one", sys.argv[2], lambda track: {"count": track["count"] + 1})
    print(row.track["count"], flush=True)
"""


def test_a_kill_loses_no_observation_that_was_answered(store, database_url):
    id = store.add_target("one", {"count": 0}).id
    command = [sys.executable, "-c", OBSERVER, database_url, id]
    with subprocess.Popen(command, cwd=Path(__file__).parents[2], stdout=subprocess.PIPE, text=True) as observer:
        assert observer.stdout is not None
        answered = [int(next(observer.stdout)) for _ in range(25)][-1]
        observer.kill()
        answered = max([answered, *(int(line) for line in observer.stdout if line.endswith("\n"))])
    kept = store.target("one", id).track["count"]
    assert kept in (answered, answered + 1)  # the last one may not have been answered yet
    assert store.change_target("one", id, lambda track: {"count": track["count"] + 1}).track["count"] == kept + 1


def test_a_change_that_is_refused_changes_nothing(store):
    row = store.add_target("one", {"count": 0})

    def refuse(_: object) -> dict[str, int]:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        store.change_target("one", row.id, refuse)
    assert store.target("one", row.id) == row
    with pytest.raises(UnknownRow):
        store.change_target("other", row.id, dict)


def test_those_observed_last_are_kept(store, monkeypatch):
    monkeypatch.setattr(targets, "TARGETS_MAX", 3)
    first, _, third = (store.add_target("one", {"n": n}) for n in range(3))
    store.change_target("one", first.id, dict)
    fourth = store.add_target("one", {"n": 3})
    store.add_target("other", {"n": 4})
    assert [row.id for row in store.targets_of_cell("one")] == [fourth.id, third.id, first.id]
    monkeypatch.setattr(targets, "AGE_MAX_S", -1.0)
    store.add_target("one", {"n": 5})
    assert store.targets_of_cell("one") == []
    assert len(store.targets_of_cell("other")) == 1


def test_a_deleted_target_is_gone_with_its_key(store):
    key = IdempotencyKey("me /targets", "k", "body")
    row = store.add_target("one", {"n": 1}, key=key)
    with pytest.raises(KeyTaken) as taken:
        store.add_target("one", {"n": 2}, key=key)
    assert taken.value.resource_id == row.id
    store.delete_target("one", row.id)
    with pytest.raises(UnknownRow):
        store.delete_target("one", row.id)
    assert store.resource_of_key(key) is None
