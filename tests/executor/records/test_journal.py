"""The journal: results and faults that survive this process and the database."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from executor.records import ExecutionResult, Journal, JournalLocked
from executor.records.journal import deliver
from store import PlanRow, Store, new_id, pack_samples

Open = Callable[[], Journal]
LANDING = {"id": new_id(), "at": 5.0, "position": [1.2, 0.3, 0.0], "std_m": 0.003}


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    store = Store.open(database_url)
    yield store
    store.close()


@pytest.fixture
def execution_id(store: Store) -> str:
    plan_id = new_id()
    store.add_plan(PlanRow(plan_id, time.time(), "cell", "0" * 64, "ruckig", b"{}"))
    store.queue_execution(plan_id, "cell")
    store.take_cell("cell", "me", "sim", "a test")
    row = store.claim_execution("cell", "me")
    assert row is not None
    return row.id


@pytest.fixture
def open_journal(tmp_path: Path) -> Iterator[Callable[[], Journal]]:
    """Opens the test's journal, once after the other has closed."""
    opened: list[Journal] = []

    def open_one() -> Journal:
        opened.append(Journal(tmp_path / "data"))
        return opened[-1]

    yield open_one
    for journal in opened:
        journal.close()


SAMPLES = pack_samples(["t", "x"], [[0.0, 0.1]])


def result(execution_id: str) -> ExecutionResult:
    return ExecutionResult(execution_id, "completed", "", {"ticks": 3}, b"mcap", SAMPLES, LANDING)


def test_a_result_is_kept_and_delivered_once(open_journal: Open, store: Store, execution_id: str) -> None:
    journal = open_journal()
    journal.keep(result(execution_id))
    assert journal.has_undelivered()
    journal.deliver(store)
    row = store.execution(execution_id)
    assert (row.state, row.outcome, row.metrics) == ("finished", "completed", {"ticks": 3})
    recording = store.recording(execution_id)
    assert (recording.mcap, recording.csv) == (b"mcap", b"t,x\n0.0,0.1\n")
    (landing,) = store.landings(execution_id)
    assert vars(landing).items() >= {**LANDING, "source": "sim-camera", "result": None}.items()
    assert not journal.has_undelivered()
    journal.deliver(store)


def test_what_one_process_kept_the_next_one_delivers(open_journal: Open, store: Store, execution_id: str) -> None:
    first = open_journal()
    first.keep(result(execution_id))
    first.close()
    open_journal().deliver(store)
    assert store.execution(execution_id).outcome == "completed"


def test_a_result_that_is_known_replaces_what_another_executor_assumed(
    open_journal: Open, store: Store, execution_id: str
) -> None:
    journal = open_journal()
    journal.keep(result(execution_id))
    store.finish_execution(execution_id, "executor_lost")
    deliver(store, result(execution_id))  # and died before it noted that
    journal.deliver(store)
    assert len(store.landings(execution_id)) == 1
    row = store.execution(execution_id)
    assert (row.outcome, row.metrics) == ("completed", {"ticks": 3})
    assert not journal.has_undelivered()


def test_a_result_that_the_database_has_otherwise_is_not_deleted(
    open_journal: Open, store: Store, execution_id: str
) -> None:
    journal = open_journal()
    journal.keep(result(execution_id))
    store.finish_execution(execution_id, "late")
    journal.deliver(store)
    assert store.execution(execution_id).outcome == "late"
    assert (journal.folder / f"{execution_id}.result.json").exists()


@pytest.mark.parametrize("is_full", [False, True])
def test_an_execution_of_another_database_is_kept_until_that_is_back(
    open_journal: Open,
    store: Store,
    execution_id: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    is_full: bool,
) -> None:
    """On the disk it survives the process, in the memory of one with a full disk it is not deleted either."""
    other = Store.open(f"sqlite:///{tmp_path / 'other.db'}")
    journal = open_journal()
    if is_full:
        monkeypatch.setattr(Journal, "_write", refuse)
    journal.keep(result(execution_id))
    journal.deliver(other)
    other.close()
    assert not journal.has_undelivered()  # to this database
    if is_full:
        assert [kept.execution_id for kept in journal._results] == [execution_id]
        return
    journal.close()
    again = open_journal()
    assert again.has_undelivered()
    again.deliver(store)
    assert store.execution(execution_id).outcome == "completed"
    assert not list(again.folder.glob(f"{execution_id}.*"))


def refuse(self: Journal, name: str, data: bytes) -> None:
    """Writes nothing, as on a full disk."""
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_fault_stays_until_a_person_has_looked(open_journal: Open) -> None:
    journal = open_journal()
    assert journal.fault() is None
    journal.latch({"outcome": "late", "reason": "x"})
    journal.close()
    again = open_journal()
    assert again.fault() == {"outcome": "late", "reason": "x"}
    again.clear_fault()
    assert again.fault() is None
    again.clear_fault()


def test_one_executor_a_cell(open_journal: Open) -> None:
    journal = open_journal()
    with pytest.raises(JournalLocked, match="another executor"):
        open_journal()
    journal.close()
    open_journal()


def test_a_full_disk_is_noticed_before_anything_moves(open_journal: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = open_journal()
    assert journal.has_room()
    monkeypatch.setattr("executor.records.journal.MIN_FREE_BYTES", 10**18)
    assert not journal.has_room()


def test_on_a_full_disk_a_result_waits_in_memory_and_leaves_nothing_half(
    open_journal: Open, store: Store, execution_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = open_journal()
    kept = Journal._write

    def full(self: Journal, name: str, data: bytes) -> None:
        kept(self, name, data[:1])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Journal, "_write", full)
    journal.keep(result(execution_id))
    journal.latch({"outcome": "late", "reason": "", "execution_id": execution_id, "at": 0.0})
    assert list(journal.folder.glob(f"{execution_id}*")) == []
    assert journal.has_undelivered()
    assert journal.fault() is not None
    journal.deliver(store)
    assert not journal.has_undelivered()
    assert store.execution(execution_id).outcome == "completed"
    assert store.recording(execution_id).mcap == b"mcap"
    journal.clear_fault()
    assert journal.fault() is None


def test_what_an_earlier_version_kept_is_delivered(open_journal: Open, store: Store, execution_id: str) -> None:
    journal = open_journal()
    journal.keep(result(execution_id))
    (journal.folder / f"{execution_id}.samples").unlink()
    (journal.folder / f"{execution_id}.csv").write_text("t,x\n0.0,0.25\n")
    journal.deliver(store)
    assert store.recording(execution_id).csv == b"t,x\n0.0,0.25\n"
    assert not list(journal.folder.glob(f"{execution_id}.*"))
