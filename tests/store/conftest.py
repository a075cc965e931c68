from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from store import Store, new_id


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    opened = Store.open(database_url)
    yield opened
    opened.close()


@pytest.fixture
def add_plan(store: Store) -> Callable[..., str]:
    def add(cell: str = "ur5e-sim") -> str:
        id = new_id()
        store.add_plan(id, 1.0, cell, "sha", "ruckig", b'{"trajectory":[]}', b"{}")
        return id

    return add
