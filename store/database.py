"""Connections to the database: opening it, transactions, and the base of the repositories.

Two processes share a SQLite file safely because of three settings: the write-ahead log (readers never wait for the
writer), `BEGIN IMMEDIATE` for writes (a busy database makes a writer wait at the start instead of fail half way), and
a busy timeout.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Row, Select, Table, create_engine, event, make_url
from sqlalchemy.exc import SQLAlchemyError

from store.errors import StoreUnavailable

BUSY_TIMEOUT_MS = 5000  # [ms] how long a writer waits for another; a transaction takes about a millisecond
READ_ONLY = {"fling_read_only": True}


def default_database_url() -> str:
    """Returns the URL of the SQLite file in the user's data folder (XDG base directories)."""
    data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return f"sqlite:///{Path(data) / 'fling' / 'fling.db'}"


def open_engine(url: str) -> Engine:
    """Returns an engine for a database URL and creates the folder of a SQLite file.

    Raises:
        StoreUnavailable: The URL is malformed, its driver is not installed, or the folder cannot be created.
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
    """Opens a read-only transaction: a consistent snapshot that never waits for a writer.

    Raises:
        StoreUnavailable: The database does not answer.
    """
    try:
        with engine.connect().execution_options(**READ_ONLY) as connection, connection.begin():
            yield connection
    except SQLAlchemyError as error:
        raise StoreUnavailable(error) from error


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Opens a write transaction, committed at the end or rolled back on an exception.

    Raises:
        StoreUnavailable: The database does not answer or rejects the statement.
    """
    try:
        with engine.begin() as connection:
            yield connection
    except SQLAlchemyError as error:
        raise StoreUnavailable(error) from error


def read_page(
    connection: Connection, query: Select[Any], table: Table, limit: int, cursor: str | None
) -> tuple[Sequence[Row[Any]], str | None]:
    """Returns one page of `query`, newest first, and the cursor of the next page (None after the last)."""
    if cursor is not None:
        query = query.where(table.c.id < cursor)
    rows = connection.execute(query.order_by(table.c.id.desc()).limit(limit + 1)).all()
    return rows[:limit], rows[limit - 1].id if len(rows) > limit else None


class Repository:
    """Shared base of the repositories: the engine and the clock."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    @staticmethod
    def _now() -> float:
        return time.time()


def _configure(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin in `_begin`, not in the driver
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA foreign_keys = ON")


def _begin(connection: Connection) -> None:
    read_only = connection.get_execution_options().get("fling_read_only", False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")
