"""Cells as their executors report them, and acknowledgements by people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import insert, select, update

from store.area import Area
from store.engine import reading, writing
from store.rows import CellRow
from store.tables import cells


class Cells(Area):
    """Statements about cells."""

    def beat(
        self,
        cell: str,
        executor_id: str,
        link_kind: str,
        robot: Mapping[str, Any] | None = None,
        fault: Mapping[str, Any] | None = None,
        read_only: bool = False,
    ) -> None:
        """The executor says that it lives, what its robot does and whether a fault is latched."""
        values = {"executor_id": executor_id, "heartbeat_at": self._now(), "link_kind": link_kind}
        values |= {"robot": dict(robot or {}), "fault": None if fault is None else dict(fault), "read_only": read_only}
        with writing(self._engine) as connection:
            if not connection.execute(update(cells).where(cells.c.cell == cell).values(**values)).rowcount:
                connection.execute(insert(cells).values(cell=cell, **values))

    def cell_status(self, cell: str) -> CellRow | None:
        """Returns what the executor of `cell` last said; None where none ever spoke."""
        with reading(self._engine) as connection:
            row = connection.execute(select(cells).where(cells.c.cell == cell)).one_or_none()
        return None if row is None else CellRow(**row._mapping)

    def cell_statuses(self) -> list[CellRow]:
        """Returns what every executor last said, by name of the cell."""
        with reading(self._engine) as connection:
            return [CellRow(**row._mapping) for row in connection.execute(select(cells).order_by(cells.c.cell))]

    def request_acknowledge(self, cell: str, who: str) -> bool:
        """A person has looked. Returns False where the cell never had an executor."""
        with writing(self._engine) as connection:
            asked = update(cells).where(cells.c.cell == cell)
            values = {"acknowledge_requested_at": self._now(), "acknowledged_by": who}
            return bool(connection.execute(asked.values(**values)).rowcount)

    def acknowledge_requested(self, cell: str) -> bool:
        """Whether a person acknowledged since the executor last cleared an acknowledgement."""
        query = select(cells.c.acknowledge_requested_at, cells.c.acknowledge_handled_at).where(cells.c.cell == cell)
        with reading(self._engine) as connection:
            row = connection.execute(query).one_or_none()
        if row is None or row.acknowledge_requested_at is None:
            return False
        return row.acknowledge_handled_at is None or row.acknowledge_requested_at > row.acknowledge_handled_at

    def clear_acknowledge(self, cell: str) -> None:
        """The executor has dealt with the acknowledgement."""
        with writing(self._engine) as connection:
            connection.execute(update(cells).where(cells.c.cell == cell).values(acknowledge_handled_at=self._now()))
