"""Landings: where an object was observed to land, or whether it hit; several a throw, kept also where withdrawn."""

from __future__ import annotations

import time
from collections.abc import Sequence

from sqlalchemy import insert, select, update

from store.database import Repository, writing
from store.idempotency_and_audit import take_key, write_audit
from store.rows import AuditLine, IdempotencyKey, LandingRow
from store.tables import landings


class LandingRepository(Repository):
    """Table `landings`."""

    def add_landing(
        self,
        id: str,
        execution_id: str,
        at: float,
        source: str,
        reported_by: str = "",
        position: Sequence[float] | None = None,
        std_m: float | None = None,
        result: str | None = None,
        radius_m: float | None = None,
        key: IdempotencyKey | None = None,
        audit: AuditLine | None = None,
    ) -> LandingRow:
        """Stores one observation, a position or a result; an id that is stored already changes nothing.

        Args:
            id: Id of the observation, from `new_id`.
            execution_id: The execution that threw the object.
            at: Time of the report [s since the epoch].
            source: What observed it, such as `person` or `sim-camera`.
            reported_by: Who reported it.
            position: Landing point (3,) in the world [m].
            std_m: Its standard deviation along each axis [m].
            result: hit, edge or miss.
            radius_m: Radius of the target that the result is about [m].
            key: Idempotency key of the request.
            audit: Who reports it.

        Raises:
            KeyTaken: `key` is bound to another observation; nothing is stored.
        """
        place = None if position is None else [float(x) for x in position]
        row = LandingRow(id, execution_id, at, source, reported_by, place, std_m, result, radius_m)
        with writing(self._engine) as connection:
            take_key(connection, key, id, at)
            if connection.execute(select(landings.c.id).where(landings.c.id == id)).one_or_none() is None:
                connection.execute(insert(landings).values(**vars(row)))
            write_audit(connection, audit, f"/executions/{execution_id}/landing")
        return row

    def landing(self, id: str) -> LandingRow | None:
        """Returns one observation."""
        return self._row(LandingRow, select(landings).where(landings.c.id == id))

    def landings(self, execution_id: str, withdrawn: bool = False) -> list[LandingRow]:
        """Returns the observations of one execution, oldest first; those that were withdrawn, too, if asked for."""
        query = select(landings).where(landings.c.execution_id == execution_id)
        if not withdrawn:
            query = query.where(landings.c.withdrawn_at.is_(None))
        return self._rows(LandingRow, query.order_by(landings.c.id))

    def withdraw_landing(self, id: str, who: str, audit: AuditLine | None = None) -> LandingRow | None:
        """Withdraws an observation, which stays listed; a second time changes nothing. Returns it, None without one."""
        with writing(self._engine) as connection:
            row = connection.execute(select(landings).where(landings.c.id == id)).one_or_none()
            if row is None:
                return None
            if row.withdrawn_at is None:
                values = {"withdrawn_at": time.time(), "withdrawn_by": who}
                connection.execute(update(landings).where(landings.c.id == id).values(**values))
            write_audit(connection, audit, f"/executions/{row.execution_id}/landing/{id}")
        return self.landing(id)
