from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from store import Store


def test_a_version_begins_where_the_files_change_even_back(store: Store):
    noted = [store.note_cell_version("c", sha, sha.encode(), None, "me") for sha in ("a", "a", "b", "a", "a")]
    assert noted == [1, 1, 2, 3, 3]
    assert store.note_cell_version("other", "a", b"a", b"calibration") == 1
    assert [(row.version, row.text) for row in store.cell_versions("c")] == [(3, b"a"), (2, b"b"), (1, b"a")]
    assert store.cell_versions("other")[0].calibration == b"calibration"


def test_of_many_that_see_it_at_once_one_makes_it(store: Store):
    with ThreadPoolExecutor(8) as pool:
        noted = set(pool.map(lambda _: store.note_cell_version("c", "a", b"a"), range(16)))
    assert noted == {1}
    assert len(store.cell_versions("c")) == 1
