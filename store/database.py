"""Connections to the database: opening it, transactions, and the base of the repositories.

Two processes share a SQLite file safely because of three settings: the write-ahead log (readers never wait for the
writer), `BEGIN IMMEDIATE` for writes (a busy database makes a writer wait at the start instead of fail half way), and
a busy timeout.
"""

from __future__ import annotations

import math
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Connection, Engine, Select, Table, create_engine, event, make_url
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import SQLAlchemyError

from store.outages import WORDS, OutageLog, kind_of

BUSY_TIMEOUT_MS = 5000  # [ms] how long a writer waits for another; a transaction takes about a millisecond
SWITCH_RETRY_S = 0.005  # [s] how long to wait before asking for the write-ahead log again
PROBE_TIMEOUT_MS = 300  # [ms] how long a probe waits: longer than any transaction of ours
READ_ONLY = {"fling_read_only": True}
RowT = TypeVar("RowT")


class StoreError(Exception):
    """Root of the errors raised by the store."""


class WrongSchema(StoreError):
    """The database was written by an older or a newer version of Fling; the message says what to do."""


class UnknownRow(StoreError):
    """There is no such plan, execution, experiment or batch; the message says which."""


class StoreUnavailable(StoreError):
    """The database does not answer, is locked for too long, full or corrupt. The cause is the driver's error.

    Attributes:
        kind: disk_full, locked, read_only, corrupt or unreachable.
        advice: The kind in words.
    """

    def __init__(self, cause: Exception) -> None:
        self.kind = kind_of(cause)
        self.advice = WORDS[self.kind]
        super().__init__(f"{self.advice}: {getattr(cause, 'orig', None) or cause}")


def open_engine(url: str) -> Engine:
    """Returns an engine for a database URL and creates the folder of a SQLite file.

    Raises:
        StoreUnavailable: The URL is malformed, its driver is not installed, or the folder cannot be created.
    """
    options = {"fling_outage_log": OutageLog()}
    try:
        address = make_url(url)
        if address.get_backend_name() != "sqlite":
            return create_engine(address, pool_pre_ping=True, execution_options=options)
        Path(address.database or "").parent.mkdir(parents=True, exist_ok=True)
    except (SQLAlchemyError, ImportError, OSError) as error:
        raise StoreUnavailable(error) from error
    engine = create_engine(address, execution_options=options)
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
        raise _noted(engine, error) from error


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
        raise _noted(engine, error) from error
    outage_log(engine).wrote()


@contextmanager
def probing(engine: Engine) -> Iterator[Connection]:
    """Opens a write transaction that waits for other writers for a moment only.

    Raises:
        StoreUnavailable: The database cannot be written to now.
    """
    is_sqlite = engine.dialect.name == "sqlite"
    try:
        with engine.connect() as connection:
            driver: Any = connection.connection.driver_connection
            if is_sqlite:
                driver.execute(f"PRAGMA busy_timeout = {PROBE_TIMEOUT_MS}")
            try:
                with connection.begin():
                    if not is_sqlite:
                        connection.exec_driver_sql(f"SET LOCAL lock_timeout = {PROBE_TIMEOUT_MS}")
                    yield connection
            finally:
                if is_sqlite:
                    driver.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    except SQLAlchemyError as error:
        raise _noted(engine, error) from error
    outage_log(engine).wrote()


def free_bytes(engine: Engine) -> float:
    """Returns the room on the disk of a SQLite file [byte]; infinite for a server, which reports by itself."""
    file = engine.url.database
    return shutil.disk_usage(file).free if engine.dialect.name == "sqlite" and file else math.inf


def outage_log(engine: Engine) -> OutageLog:
    """Returns the log of the outages of an engine's database."""
    return engine.get_execution_options()["fling_outage_log"]


def insert_if_new(connection: Connection, table: Table, **values: Any) -> Any:
    """Returns the statement that inserts a row unless one with its key is there; SQLAlchemy has it a dialect each."""
    insert = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}[connection.dialect.name]
    return insert(table).values(**values).on_conflict_do_nothing()


def required_row(
    connection: Connection, kind: Callable[..., RowT], query: Select[Any], what: str, lock: bool = False
) -> RowT:
    """Returns the one row of a query within the caller's transaction.

    Args:
        connection: of the transaction.
        kind: of the row.
        query: for one row.
        what: it is, for the error.
        lock: whether nobody else may change it until the transaction ends.

    Raises:
        UnknownRow: There is none.
    """
    row = connection.execute(query.with_for_update() if lock else query).one_or_none()
    if row is None:
        raise UnknownRow(f"no {what}")
    return kind(**row._mapping)


class Repository:
    """Shared base of the repositories: the engine, and queries by dataclass."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def _row(self, kind: Callable[..., RowT], query: Select[Any]) -> RowT | None:
        """Returns the only row of `query` as a `kind`; None if there is none."""
        rows = self._rows(kind, query)
        return rows[0] if rows else None

    def _rows(self, kind: Callable[..., RowT], query: Select[Any]) -> list[RowT]:
        with reading(self._engine) as connection:
            return [kind(**row._mapping) for row in connection.execute(query)]

    def _page(
        self, kind: Callable[..., RowT], query: Select[Any], table: Table, limit: int, cursor: str | None
    ) -> tuple[list[RowT], str | None]:
        """Returns one page of `query`, newest first, and the cursor of the next page (None after the last)."""
        if cursor is not None:
            query = query.where(table.c.id < cursor)
        rows: list[Any] = self._rows(kind, query.order_by(table.c.id.desc()).limit(limit + 1))
        return rows[:limit], rows[limit - 1].id if len(rows) > limit else None

    def _value(self, query: Select[Any]) -> Any:
        """Returns the only value of `query`; None if there is none."""
        with reading(self._engine) as connection:
            return connection.execute(query).scalar_one_or_none()


def _noted(engine: Engine, error: SQLAlchemyError) -> StoreUnavailable:
    """Returns the store's error for one of SQLAlchemy, logged once an outage."""
    unavailable = StoreUnavailable(error)
    outage_log(engine).failed(unavailable.kind, str(error.__cause__ or error).splitlines()[0])
    return unavailable


def _configure(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin in `_begin`, not in the driver
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    _use_write_ahead_log(connection)
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA foreign_keys = ON")


def _use_write_ahead_log(connection: Any) -> None:
    """Switches a file to the write-ahead log; the first to open it does, the others find it so.

    SQLite does not wait here: two connections that both switch, each holding a lock that the other needs, would wait
    for ever, so one of them is told at once that the file is locked (sqlite.org/c3ref/busy_handler.html). By the time
    it asks again, the other has switched.
    """
    latest = time.monotonic() + BUSY_TIMEOUT_MS / 1000.0
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() > latest:
                raise
            time.sleep(SWITCH_RETRY_S)
        else:
            return


def _begin(connection: Connection) -> None:
    read_only = connection.get_execution_options().get("fling_read_only", False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")
