"""Tracked targets: what is known of each at its last observation."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from sqlalchemy import Connection, delete, insert, select, update

from store.database import Repository, UnknownRow, writing
from store.idempotency_and_audit import take_key, write_audit
from store.rows import AuditLine, IdempotencyKey, TrackedTargetRow, new_id
from store.tables import idempotency, targets

TARGETS_MAX = 100  # of a cell: those observed last stay; a belt brings one every second or so
AGE_MAX_S = 3600.0  # [s] without an observation, after which nobody plans to a target


class TrackedTargetRepository(Repository):
    """Table `targets`."""

    def add_target(
        self,
        cell: str,
        track: Mapping[str, Any],
        created_by: str = "",
        key: IdempotencyKey | None = None,
        audit: AuditLine | None = None,
    ) -> TrackedTargetRow:
        """Stores a target after its first observation; those of the cell that are old or too many go.

        Raises:
            KeyTaken: `key` is bound to another target; nothing is stored.
        """
        now = time.time()
        row = TrackedTargetRow(new_id(), cell, now, created_by, now, track)
        with writing(self._engine) as connection:
            take_key(connection, key, row.id, now)
            connection.execute(insert(targets).values(**vars(row)))
            _delete_old(connection, cell, now)
            write_audit(connection, audit, f"/cells/{cell}/targets/{row.id}")
        return row

    def change_target(
        self, cell: str, id: str, change: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    ) -> TrackedTargetRow:
        """Stores what an observation makes of a target's track, and returns the target.

        Of two at once the second one finds what the first has made; `change` raises what it refuses.

        Raises:
            UnknownRow: The cell has no such target.
        """
        of_cell = (targets.c.cell == cell) & (targets.c.id == id)
        with writing(self._engine) as connection:
            found = connection.execute(select(targets).where(of_cell).with_for_update()).one_or_none()
            if found is None:
                raise UnknownRow(_missing(cell, id))
            values = {"track": dict(change(found.track)), "observed_at": time.time()}
            connection.execute(update(targets).where(of_cell).values(**values))
            return TrackedTargetRow(**{**found._mapping, **values})

    def target(self, cell: str, id: str) -> TrackedTargetRow:
        """Returns one target of a cell.

        Raises:
            UnknownRow: The cell has no such target.
        """
        row = self._row(TrackedTargetRow, select(targets).where(targets.c.cell == cell, targets.c.id == id))
        if row is None:
            raise UnknownRow(_missing(cell, id))
        return row

    def targets_of_cell(self, cell: str) -> list[TrackedTargetRow]:
        """Returns the targets of a cell, newest first."""
        query = select(targets).where(targets.c.cell == cell)
        return self._rows(TrackedTargetRow, query.order_by(targets.c.id.desc()))

    def delete_target(self, cell: str, id: str, audit: AuditLine | None = None) -> TrackedTargetRow:
        """Deletes one target of a cell, and returns it.

        Raises:
            UnknownRow: The cell has no such target.
        """
        with writing(self._engine) as connection:
            gone = delete(targets).where(targets.c.cell == cell, targets.c.id == id).returning(*targets.c)
            found = connection.execute(gone).one_or_none()
            if found is None:
                raise UnknownRow(_missing(cell, id))
            connection.execute(delete(idempotency).where(idempotency.c.resource_id == id))
            write_audit(connection, audit, f"/cells/{cell}/targets/{id}")
        return TrackedTargetRow(**found._mapping)


def _missing(cell: str, id: str) -> str:
    return f"cell {cell!r} tracks no target {id!r}"


def _delete_old(connection: Connection, cell: str, now: float) -> None:
    """Deletes the targets of a cell that were not observed for long, and those beyond `TARGETS_MAX`."""
    of_cell = targets.c.cell == cell
    last = targets.c.observed_at.desc(), targets.c.id.desc()
    kept = select(targets.c.id).where(of_cell, targets.c.observed_at >= now - AGE_MAX_S).order_by(*last)
    gone = delete(targets).where(of_cell, targets.c.id.not_in(kept.limit(TARGETS_MAX))).returning(targets.c.id)
    ids = list(connection.execute(gone).scalars())
    if ids:
        connection.execute(delete(idempotency).where(idempotency.c.resource_id.in_(ids)))
