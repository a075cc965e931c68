"""Status of the cells: heartbeats of their executors, latched faults, acknowledgements by people."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import insert, select, update

from store.database import Repository, writing
from store.idempotency_and_audit import write_audit
from store.rows import AuditLine, CellRow
from store.tables import cells


class CellStatusRepository(Repository):
    """Table `cells`."""

    def record_heartbeat(
        self,
        cell: str,
        executor_id: str,
        link_kind: str,
        robot: Mapping[str, Any] | None = None,
        fault: Mapping[str, Any] | None = None,
        read_only: bool = False,
    ) -> None:
        """Records a heartbeat of the cell's executor with the robot's state and the latched fault, if any."""
        values = {"executor_id": executor_id, "heartbeat_at": time.time(), "link_kind": link_kind}
        values |= {"robot": dict(robot or {}), "fault": None if fault is None else dict(fault), "read_only": read_only}
        with writing(self._engine) as connection:
            if not connection.execute(update(cells).where(cells.c.cell == cell).values(**values)).rowcount:
                connection.execute(insert(cells).values(cell=cell, **values))

    def cell_status(self, cell: str) -> CellRow | None:
        """Returns the last heartbeat of the cell's executor; None if it never had one."""
        return self._row(CellRow, select(cells).where(cells.c.cell == cell))

    def cell_statuses(self) -> list[CellRow]:
        """Returns the last heartbeat of every executor, sorted by cell name."""
        return self._rows(CellRow, select(cells).order_by(cells.c.cell))

    def request_acknowledge(self, cell: str, who: str, audit: AuditLine | None = None) -> bool:
        """Records that a person acknowledged the fault. Returns False if the cell never had an executor."""
        with writing(self._engine) as connection:
            status = update(cells).where(cells.c.cell == cell)
            values = {"acknowledge_requested_at": time.time(), "acknowledged_by": who}
            known = bool(connection.execute(status.values(**values)).rowcount)
            write_audit(connection, audit, f"/cells/{cell}")
            return known

    def acknowledge_requested(self, cell: str) -> bool:
        """Returns whether an acknowledgement waits for the executor."""
        row = self.cell_status(cell)
        if row is None or row.acknowledge_requested_at is None:
            return False
        return row.acknowledge_handled_at is None or row.acknowledge_requested_at > row.acknowledge_handled_at

    def clear_acknowledge(self, cell: str) -> None:
        """Records that the executor handled the acknowledgement."""
        with writing(self._engine) as connection:
            connection.execute(update(cells).where(cells.c.cell == cell).values(acknowledge_handled_at=time.time()))
