"""`Store`: the one door to the database, put together from its areas."""

from __future__ import annotations

from typing import Self

from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from store import migrations
from store.access import Access
from store.cells import Cells
from store.engine import open_engine, reading
from store.errors import StoreUnavailable
from store.executions import Executions
from store.plans import Plans
from store.runs import Runs


class Store(Plans, Executions, Runs, Cells, Access):
    """Plans, executions, events, recordings, cells, idempotency keys and the audit trail.

    Every method is one transaction. Safe to share between threads; each process opens its own.
    """

    @classmethod
    def open(cls, url: str) -> Self:
        """Opens `url`. A SQLite file is created and brought up to date; PostgreSQL by `fling db upgrade` alone.

        Raises:
            RuntimeError: the database is older (PostgreSQL) or newer than this Fling.
            StoreUnavailable: there is no database at `url`.
        """
        engine = open_engine(url)
        try:
            if engine.dialect.name == "sqlite":
                migrations.upgrade(engine)
            else:
                migrations.check(engine)
        except (RuntimeError, SQLAlchemyError) as error:
            engine.dispose()
            if isinstance(error, SQLAlchemyError):
                raise StoreUnavailable(error) from error
            raise
        return cls(engine)

    @staticmethod
    def upgrade(url: str) -> tuple[int, int]:
        """Brings the database at `url` up to date. Returns its version before and after."""
        engine = open_engine(url)
        try:
            return migrations.upgrade(engine)
        except SQLAlchemyError as error:
            raise StoreUnavailable(error) from error
        finally:
            engine.dispose()

    def is_reachable(self) -> bool:
        """Whether the database answers."""
        try:
            with reading(self._engine) as connection:
                connection.execute(text("SELECT 1 FROM plans LIMIT 1"))
        except StoreUnavailable:
            return False
        return True

    def close(self) -> None:
        """Closes every connection."""
        self._engine.dispose()
