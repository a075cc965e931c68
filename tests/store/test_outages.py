"""A full disk, a lock and a server that is gone are told apart, and logged once each."""

from __future__ import annotations

import logging
import resource
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from store import PlanRow, Store, StoreUnavailable, new_id
from store.database import open_engine


@contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """No file of this process grows beyond `size` [byte], as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)


def add_plan(store: Store, size: int = 10) -> None:
    store.add_plan(PlanRow(new_id(), 1.0, "c", "s", "b", bytes(size)))


def outage_of(call) -> StoreUnavailable:
    with pytest.raises(StoreUnavailable) as caught:
        call()
    return caught.value


def test_a_full_disk(sqlite_url: str, caplog: pytest.LogCaptureFixture):
    store = Store.open(sqlite_url)
    with files_end_at(200_000):
        for _ in range(5):
            assert outage_of(lambda: add_plan(store, 1_000_000)).kind == "disk_full"
    add_plan(store)
    assert len(store.plans()[0]) == 1
    store.close()
    assert [r.levelname for r in caplog.records if r.name == "fling.store"] == ["ERROR", "WARNING"]
    assert caplog.records[-1].fields["failures"] == 5


def test_a_locked_database(sqlite_url: str, monkeypatch: pytest.MonkeyPatch):
    store = Store.open(sqlite_url)
    other = sqlite3.connect(sqlite_url.removeprefix("sqlite:///"), isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    error = outage_of(store.check_writable)
    assert (error.kind, error.advice) == ("locked", "the database is locked by another process")
    assert store.plans(limit=1) == ([], None)  # readers need no lock
    other.execute("ROLLBACK")
    other.close()
    store.check_writable()
    with store._engine.connect() as connection:  # a probe leaves no impatient connection behind
        assert connection.exec_driver_sql("PRAGMA busy_timeout").scalar_one() == 5000
    store.close()


def test_a_locked_postgresql(store: Store, database_url: str):
    if database_url.startswith("sqlite"):
        pytest.skip("SQLite has a test of its own; `make verify` runs this one on PostgreSQL")
    engine = open_engine(database_url)
    with engine.begin() as connection:
        connection.exec_driver_sql("LOCK TABLE probes")
        assert outage_of(store.check_writable).kind == "locked"
    engine.dispose()
    store.check_writable()


def test_no_room_is_noticed_before_a_write_fails(sqlite_url: str, monkeypatch: pytest.MonkeyPatch):
    store = Store.open(sqlite_url)
    monkeypatch.setattr("store.store.free_bytes", lambda _: 1e6)
    assert outage_of(store.check_writable).kind == "disk_full"
    store.close()


def test_a_damaged_file_a_missing_server_and_a_missing_folder(tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("this is not a database, but long enough to be read as one " * 20)
    assert outage_of(lambda: Store.open(f"sqlite:///{file}")).kind == "corrupt"
    gone = "postgresql+psycopg://nobody@127.0.42.2:1/none?connect_timeout=1"
    assert outage_of(lambda: Store.open(gone)).kind == "unreachable"
    assert outage_of(lambda: Store.open(f"sqlite:///{file}/in/a/file.db")).kind == "unreachable"


def test_an_outage_that_changes_its_kind_is_logged_again(caplog: pytest.LogCaptureFixture):
    from store.outages import OutageLog

    log = OutageLog()
    log.failed("corrupt", "muted while the database is opened")
    log.is_muted = False
    for kind in ("locked", "locked", "unreachable", "unreachable"):
        log.failed(kind, "why")
    log.wrote()
    log.wrote()
    lines = [(r.levelno, r.fields["outage"]) for r in caplog.records]
    assert lines == [(logging.ERROR, "locked"), (logging.ERROR, "unreachable"), (logging.WARNING, "unreachable")]
