"""`Store`: the repositories of all tables over one database connection."""

from __future__ import annotations

from typing import Self

from sqlalchemy import text

from store import migrations
from store.cell_status import CellStatusRepository
from store.database import StoreError, StoreUnavailable, open_engine, reading
from store.executions import ExecutionRepository
from store.experiments import ExperimentRepository
from store.idempotency_and_audit import ClientRepository
from store.landings import LandingRepository
from store.plans import PlanRepository


class Store(
    PlanRepository,
    ExecutionRepository,
    ExperimentRepository,
    LandingRepository,
    CellStatusRepository,
    ClientRepository,
):
    """Plans, executions, events, recordings, experiments, landings, cell status, idempotency keys and the audit trail.

    Every method is one transaction. Threads may share a store; each process opens its own.
    """

    @classmethod
    def open(cls, url: str) -> Self:
        """Opens the database. SQLite is created and migrated; PostgreSQL must be migrated by `fling db upgrade`.

        Raises:
            RuntimeError: The schema is older (PostgreSQL) or newer than this version of Fling.
            StoreUnavailable: There is no usable database at `url`.
        """
        engine = open_engine(url)
        try:
            if engine.dialect.name == "sqlite":
                migrations.upgrade(engine)
            else:
                migrations.check(engine)
        except (RuntimeError, StoreError):
            engine.dispose()
            raise
        return cls(engine)

    @staticmethod
    def upgrade(url: str) -> tuple[int, int]:
        """Migrates the database at `url`. Returns its schema version before and after."""
        engine = open_engine(url)
        try:
            return migrations.upgrade(engine)
        finally:
            engine.dispose()

    def is_reachable(self) -> bool:
        """Returns whether the database answers."""
        try:
            with reading(self._engine) as connection:
                connection.execute(text("SELECT 1 FROM plans LIMIT 1"))
        except StoreUnavailable:
            return False
        return True

    def close(self) -> None:
        """Closes all connections."""
        self._engine.dispose()
