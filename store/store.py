"""`Store`: the repositories of all tables over one database connection."""

from __future__ import annotations

import errno
import time
from typing import Self

from sqlalchemy import update

from store import migrations
from store.cells import CellStatusRepository, CellVersionRepository
from store.database import StoreError, StoreUnavailable, free_bytes, open_engine, outage_log, probing
from store.executions import ExecutionRepository
from store.experiments import ExperimentRepository
from store.idempotency_and_audit import ClientRepository
from store.landings import LandingRepository
from store.many import BatchRepository, JobRepository, MapRepository
from store.plans import PlanRepository
from store.profiles import ProfileRepository
from store.retention import RetentionRepository
from store.tables import probes
from store.targets import TrackedTargetRepository

FREE_MIN_BYTES = 20e6  # [byte] some hundred plans; the write-ahead log alone may grow to 4 MB


class Store(
    PlanRepository,
    BatchRepository,
    JobRepository,
    ExecutionRepository,
    ExperimentRepository,
    LandingRepository,
    MapRepository,
    CellStatusRepository,
    ClientRepository,
    ProfileRepository,
    TrackedTargetRepository,
    RetentionRepository,
    CellVersionRepository,
):
    """Plans, batches, maps, jobs, executions, recordings, landings, profiles, targets, cells, keys, audit trail …

    Every method is one transaction. Threads may share a store; each process opens its own.
    """

    @classmethod
    def open(cls, url: str) -> Self:
        """Opens the database. SQLite is created and migrated; PostgreSQL must be migrated by `fling db upgrade`.

        Raises:
            StoreError: The schema is older (PostgreSQL) or newer than this version of Fling.
            StoreUnavailable: There is no usable database at `url`.
        """
        engine = open_engine(url)
        try:
            if engine.dialect.name == "sqlite":
                migrations.upgrade(engine)
            else:
                migrations.check(engine)
        except StoreError:
            engine.dispose()
            raise
        outage_log(engine).is_muted = False
        return cls(engine)

    @staticmethod
    def upgrade(url: str) -> tuple[int, int]:
        """Migrates the database at `url`. Returns its schema version before and after."""
        engine = open_engine(url)
        try:
            return migrations.upgrade(engine)
        finally:
            engine.dispose()

    def check_writable(self) -> None:
        """Writes one row; a database that is locked is waited for a moment only.

        Raises:
            StoreUnavailable: The database cannot be written to, or has no room left, with the kind of the outage.
        """
        with probing(self._engine) as connection:
            connection.execute(update(probes).values(at=time.time()))
        self.require_room()

    def require_room(self) -> None:
        """Returns where there is room for new work; the rest of the disk is for what runs, and for stops.

        Raises:
            StoreUnavailable: There is none.
        """
        if free_bytes(self._engine) < FREE_MIN_BYTES:
            raise StoreUnavailable(OSError(errno.ENOSPC, "less than 20 MB are left"))

    def close(self) -> None:
        """Closes all connections."""
        self._engine.dispose()
