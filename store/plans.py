"""Plans: written once by the service, never changed."""

from __future__ import annotations

from sqlalchemy import insert, select

from store.access import take_key
from store.area import Area
from store.engine import reading, writing
from store.rows import IdempotencyKey, PlanRow
from store.tables import plans

SUMMARY_COLUMNS = [column for column in plans.c if column.name != "document"]


class Plans(Area):
    """Statements about plans."""

    def add_plan(
        self,
        id: str,
        created_at: float,
        cell: str,
        cell_sha256: str,
        backend: str,
        document: bytes,
        summary: bytes | None = None,
        key: IdempotencyKey | None = None,
    ) -> None:
        """Stores one plan; `summary` is the document without its trajectory (by default the document itself).

        Raises:
            KeyTaken: `key` stands for another plan already; nothing is stored.
        """
        row = PlanRow(id, created_at, cell, cell_sha256, backend, document if summary is None else summary, document)
        with writing(self._engine) as connection:
            take_key(connection, key, id, created_at)
            connection.execute(insert(plans).values(**vars(row)))

    def plan(self, id: str) -> PlanRow | None:
        """Returns one plan with its whole document."""
        with reading(self._engine) as connection:
            row = connection.execute(select(plans).where(plans.c.id == id)).one_or_none()
        return None if row is None else PlanRow(**row._mapping)

    def plan_summary(self, id: str) -> PlanRow | None:
        """Returns one plan without its trajectory."""
        with reading(self._engine) as connection:
            row = connection.execute(select(*SUMMARY_COLUMNS).where(plans.c.id == id)).one_or_none()
        return None if row is None else PlanRow(**row._mapping)

    def plans(self, limit: int = 50, cursor: str | None = None) -> tuple[list[PlanRow], str | None]:
        """Returns plans, newest first and without trajectories, and the cursor of the next page (None: no more)."""
        query = select(*SUMMARY_COLUMNS).order_by(plans.c.id.desc()).limit(limit + 1)
        if cursor is not None:
            query = query.where(plans.c.id < cursor)
        with reading(self._engine) as connection:
            rows = [PlanRow(**row._mapping) for row in connection.execute(query)]
        return rows[:limit], rows[limit - 1].id if len(rows) > limit else None
