"""The store on SQLite, and on PostgreSQL if FLING_TEST_POSTGRES names a server; one database per test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from store import PlanRow, Store, new_id, pack_trajectory
from tests.postgres import POSTGRES, database_on

TRAJECTORY = {
    "joint_names": ["a", "b"],
    "time_from_start": [0.0, 0.1],
    "positions": [[0.1, 0.2], [1 / 3, -2e-17]],
    "velocities": [[0.0, 1.0], [2.0, 3.0]],
    "accelerations": [[4.0, 5.0], [6.0, 7.0]],
}


@pytest.fixture(params=["sqlite", *(["postgresql"] if POSTGRES else [])])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Yields the URL of an empty database for one test."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'fling.db'}"
        return
    with database_on(str(POSTGRES)) as url:
        yield url


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    """Returns the URL of an empty SQLite file for one test."""
    return f"sqlite:///{tmp_path / 'own.db'}"


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    """Yields an empty store."""
    Store.upgrade(database_url)
    opened = Store.open(database_url)
    yield opened
    opened.close()


@pytest.fixture
def add_plan(store: Store) -> Callable[..., str]:
    """Returns a function that adds a plan and returns its id."""

    def add(cell: str = "ur5e-sim") -> str:
        id = new_id()
        store.add_plan(PlanRow(id, 1.0, cell, "sha", "ruckig", b'{"id":1}', samples=pack_trajectory(TRAJECTORY)))
        return id

    return add
