"""Opening a database so that two processes can share it.

SQLite: write-ahead log, so that readers never wait for the writer; writes begin with the lock (`BEGIN IMMEDIATE`), so
that a busy database makes them wait instead of failing half way; foreign keys on.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import SQLAlchemyError

from store.errors import StoreUnavailable

BUSY_TIMEOUT_MS = 5000  # [ms] a writer waits this long for the other; its transactions take about a millisecond
READING = {"fling_reading": True}


def open_engine(url: str) -> Engine:
    """Returns an engine for `url`; makes the folder of a SQLite file.

    Raises:
        StoreUnavailable: the address cannot be read, its driver is not installed, the folder cannot be made.
    """
    try:
        address = make_url(url)
        if address.get_backend_name() != "sqlite":
            return create_engine(address, pool_pre_ping=True)
        Path(address.database or "").parent.mkdir(parents=True, exist_ok=True)
    except (SQLAlchemyError, ImportError, OSError) as error:
        raise StoreUnavailable(error) from error
    engine = create_engine(address)
    event.listen(engine, "connect", _configure)
    event.listen(engine, "begin", _begin)
    return engine


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """A transaction that only reads: never waits for a writer, sees one state.

    Raises:
        StoreUnavailable: the database does not answer.
    """
    try:
        with engine.connect().execution_options(**READING) as connection, connection.begin():
            yield connection
    except SQLAlchemyError as error:
        raise StoreUnavailable(error) from error


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """A transaction that writes: all of it, or nothing.

    Raises:
        StoreUnavailable: the database does not answer, or refuses.
    """
    try:
        with engine.begin() as connection:
            yield connection
    except SQLAlchemyError as error:
        raise StoreUnavailable(error) from error


def _configure(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # the driver begins nothing by itself
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA foreign_keys = ON")


def _begin(connection: Connection) -> None:
    read = connection.get_execution_options().get("fling_reading", False)
    connection.exec_driver_sql("BEGIN" if read else "BEGIN IMMEDIATE")
