"""The lease of a cell: who waits for whom, and what a newcomer finds."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from executor import ownership
from executor.ownership import CellTaken, take_cell, take_controller
from executor.robot import Monitor
from planner.cell import Cell, load_cell
from store import Store
from tests.executor.conftest import CELLS


@pytest.fixture
def cell() -> Cell:
    return load_cell(CELLS / "ur5e-sim.toml")


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    found = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    yield found
    found.close()


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ownership, "LEASE_S", 0.5)
    monkeypatch.setattr(ownership, "FREED_S", 0.1)
    monkeypatch.setattr(ownership, "CONNECT_S", 0.1)
    monkeypatch.setattr(ownership, "LOOK_S", 0.02)


def test_a_cell_that_is_new_or_given_up_is_taken_at_once(store: Store, cell: Cell) -> None:
    take_cell(store, cell, "one", None)
    store.leave_cell(cell.name, "one")
    take_cell(store, cell, "two", None)
    assert store.cell_status(cell.name).executor_id == "two"


def test_the_next_executor_of_a_folder_waits_for_nobody(
    store: Store, cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    take_cell(store, cell, "one", None)
    monkeypatch.setattr(ownership, "LEASE_S", 1e9)
    take_cell(store, cell, "two", "one")
    assert store.cell_status(cell.name).executor_id == "two"


def test_who_lives_keeps_the_cell(store: Store, cell: Cell) -> None:
    take_cell(store, cell, "one", None)
    ended = threading.Event()

    def live() -> None:
        while not ended.wait(0.05):
            store.record_heartbeat(cell.name, "one", "sim")

    thread = threading.Thread(target=live)
    thread.start()
    try:
        with pytest.raises(CellTaken, match=r"another executor of cell 'ur5e-sim' is running \(process \d+ on "):
            take_cell(store, cell, "two", None)
    finally:
        ended.set()
        thread.join()
    assert store.cell_status(cell.name).executor_id == "one"


def test_who_is_silent_for_a_lease_loses_the_cell(store: Store, cell: Cell) -> None:
    take_cell(store, cell, "one", None)
    take_cell(store, cell, "two", None)
    assert not store.record_heartbeat(cell.name, "one", "sim")


@pytest.mark.parametrize("owned", [True, None])
def test_a_controller_that_is_ours_or_away_is_taken(owned: bool | None) -> None:
    monitor = Monitor("127.0.42.2")
    monitor.owned = owned
    take_controller(monitor)


def test_a_controller_of_another_executor_is_left_alone() -> None:
    monitor = Monitor("127.0.42.2")
    monitor.looked.set()
    monitor.owned = False
    with pytest.raises(CellTaken, match=r"another executor is connected to the controller at 127\.0\.42\.2"):
        take_controller(monitor)
    threading.Timer(0.05, lambda: setattr(monitor, "owned", True)).start()
    take_controller(monitor)  # that of before was noticed to have ended
