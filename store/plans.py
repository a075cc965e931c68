"""Plans: written once by the service, never changed."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from sqlalchemy import Connection, insert, select

from store.database import Repository, insert_if_new, reading, writing
from store.idempotency_and_audit import take_key
from store.rows import IdempotencyKey, PlanRow
from store.tables import plans

SUMMARY_COLUMNS = [column for column in plans.c if column.name not in ("document", "samples")]
ALL_COLUMNS: list[Any] = [*SUMMARY_COLUMNS, plans.c.samples, plans.c.document.label("earlier_document")]


class PlanRepository(Repository):
    """Table `plans`."""

    def add_plan(self, row: PlanRow, key: IdempotencyKey | None = None) -> None:
        """Stores one plan.

        Args:
            row: The plan, with its trajectory.
            key: Idempotency key of the request.

        Raises:
            KeyTaken: `key` is bound to another plan; nothing is stored.
        """
        with writing(self._engine) as connection:
            take_key(connection, key, row.id, row.created_at)
            connection.execute(insert(plans).values(**_columns(row)))

    def plan(self, id: str) -> PlanRow | None:
        """Returns one plan with its trajectory."""
        query: Any = select(*ALL_COLUMNS).where(plans.c.id == id)
        return self._row(PlanRow, query)

    def plan_summary(self, id: str) -> PlanRow | None:
        """Returns one plan without its trajectory."""
        return self._row(PlanRow, select(*SUMMARY_COLUMNS).where(plans.c.id == id))

    def cell_hashes_of_plans(self, ids: Collection[str]) -> dict[str, str]:
        """Returns the hash of the cell's files that each of these plans was made for."""
        with reading(self._engine) as connection:
            rows = connection.execute(select(plans.c.id, plans.c.cell_sha256).where(plans.c.id.in_(list(ids))))
            return {id: sha256 for id, sha256 in rows}

    def plans(self, limit: int = 50, cursor: str | None = None) -> tuple[list[PlanRow], str | None]:
        """Returns plans without trajectories, newest first, and the cursor of the next page (None after the last)."""
        return self._page(PlanRow, select(*SUMMARY_COLUMNS), plans, limit, cursor)


def insert_plan_if_new(connection: Connection, row: PlanRow) -> None:
    """Stores a plan, unless there is one with its id."""
    connection.execute(insert_if_new(connection, plans, **_columns(row)))


def _columns(row: PlanRow) -> dict[str, Any]:
    values = dict(vars(row))
    values["document"] = values.pop("earlier_document")
    return values
