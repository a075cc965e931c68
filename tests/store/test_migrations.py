from __future__ import annotations

import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from sqlalchemy import inspect, text

from store import Store, StoreError, StoreUnavailable, database, migrations
from store.database import open_engine
from store.tables import METADATA


def test_the_migrations_make_the_tables_that_the_code_knows(store):
    made = inspect(store._engine)
    assert set(made.get_table_names()) == set(METADATA.tables) | {"schema_steps"}
    for name, table in METADATA.tables.items():
        columns = {c["name"]: c for c in made.get_columns(name)}
        key = made.get_pk_constraint(name)["constrained_columns"]
        assert key and set(columns) == set(table.c.keys())
        for column in table.c:
            found = columns[column.name]
            assert found["type"].python_type is column.type.python_type, f"{name}.{column.name}"
            if column.name not in key:
                assert found["nullable"] == column.nullable, f"{name}.{column.name}"


def test_the_partial_index_is_unique_and_partial(store):
    indexes = inspect(store._engine).get_indexes("executions")
    index = next(index for index in indexes if index["name"] == "one_active_execution_per_cell")
    assert (index["name"], index["unique"]) == ("one_active_execution_per_cell", 1)
    option = f"{store._engine.dialect.name}_where"
    assert "finished" in str(index["dialect_options"][option])


def test_upgrading_twice_changes_nothing(database_url):
    assert Store.upgrade(database_url) == (0, migrations.LATEST)
    assert Store.upgrade(database_url) == (migrations.LATEST, migrations.LATEST)


def test_many_may_open_an_empty_database_at_once(database_url):
    def attempt(_: int) -> bool:
        Store.upgrade(database_url)
        opened = Store.open(database_url)
        try:
            return opened.plans(limit=1) == ([], None)
        finally:
            opened.close()

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(attempt, range(8)))


def test_a_newer_database_is_refused(database_url):
    Store.upgrade(database_url)
    engine = open_engine(database_url)
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO schema_steps (number) VALUES (99)"))
    engine.dispose()
    with pytest.raises(StoreError, match="newer"):
        Store.open(database_url)


def test_an_older_postgresql_is_refused_and_an_older_sqlite_upgraded(database_url):
    if database_url.startswith("sqlite"):
        Store.open(database_url).close()
        assert Store.upgrade(database_url) == (migrations.LATEST, migrations.LATEST)
    else:
        with pytest.raises(StoreError, match="fling db upgrade"):
            Store.open(database_url)


def test_a_file_that_is_no_database_is_refused(tmp_path):
    file = tmp_path / "file"
    file.write_text("this is not a database, but long enough to be read as one " * 20)
    with pytest.raises(StoreUnavailable):
        Store.open(f"sqlite:///{file}")


@pytest.mark.slow
def test_many_may_switch_an_empty_file_to_the_write_ahead_log_at_once(tmp_path):
    def attempt(url: str, ready: Barrier) -> str:
        engine = open_engine(url)
        ready.wait()
        with engine.connect() as connection:
            mode = connection.exec_driver_sql("PRAGMA journal_mode").scalar_one()
        engine.dispose()
        return mode

    with ThreadPoolExecutor(8) as pool:  # the first to ask meets the second in one round of twenty or so
        for number in range(200):
            ready = Barrier(8)
            attempts = [pool.submit(attempt, f"sqlite:///{tmp_path / str(number)}", ready) for _ in range(8)]
            assert {a.result() for a in attempts} == {"wal"}


def test_a_file_that_stays_locked_is_reported_after_the_timeout(sqlite_url, monkeypatch):
    monkeypatch.setattr(database, "BUSY_TIMEOUT_MS", 50)
    holder = sqlite3.connect(sqlite_url.removeprefix("sqlite:///"))
    holder.execute("BEGIN EXCLUSIVE")
    started = time.monotonic()
    with pytest.raises(StoreUnavailable) as refusal, database.reading(open_engine(sqlite_url)):
        pass
    holder.close()
    assert refusal.value.kind == "locked" and time.monotonic() - started > 0.05


def test_sqlite_runs_in_write_ahead_mode_with_foreign_keys(sqlite_url):
    store = Store.open(sqlite_url)
    with store._engine.connect() as connection:
        pragma = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar_one()
            for name in ("journal_mode", "foreign_keys", "busy_timeout")
        }
    store.close()
    assert pragma == {"journal_mode": "wal", "foreign_keys": 1, "busy_timeout": 5000}
