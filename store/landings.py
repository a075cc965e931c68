"""Landings: where an object was observed to land, or whether it hit; several a throw, never changed."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import insert, select

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

    def landings(self, execution_id: str) -> list[LandingRow]:
        """Returns the observations of one execution, oldest first."""
        query = select(landings).where(landings.c.execution_id == execution_id)
        return self._rows(LandingRow, query.order_by(landings.c.id))
