from __future__ import annotations

import hashlib

from store import Store


def test_a_profile_comes_back_as_it_was_written_with_its_hash(store: Store):
    row = store.add_profile("a", "sha", "ann", b'{"lag_s":0.02}')
    assert store.profile(row.id) == row
    assert row.sha256 == hashlib.sha256(b'{"lag_s":0.02}').hexdigest()
    assert store.profile("nothing") is None
    newer = store.add_profile("a", "sha", "ann", b"{}")
    store.add_profile("b", "sha", "ann", b"{}")
    assert [x.id for x in store.profiles_of_cell("a")] == [newer.id, row.id]


def test_the_newest_adoption_counts_and_none_means_the_cell_file(store: Store):
    first, second = (store.add_profile("a", "sha", "ann", b"{}") for _ in range(2))
    assert store.adopted_profile("a") is None
    store.adopt_profile("a", second.id, "ann")
    store.adopt_profile("a", first.id, "ben")
    assert store.adopted_profile("a") == first
    assert store.adopted_profile("b") is None
    store.adopt_profile("a", None, "ben")
    assert store.adopted_profile("a") is None


def test_a_profile_is_in_use_with_the_files_that_it_was_learnt_with_alone(store: Store):
    learnt = store.add_profile("a", "sha", "ann", b"{}")
    store.adopt_profile("a", learnt.id, "ann")
    assert store.profile_in_use("a", "sha") == learnt
    assert store.profile_in_use("a", "another") is None
    assert store.profile_in_use("b", "sha") is None
