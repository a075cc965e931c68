"""Cells: heartbeats of their executors, latched faults, acknowledgements by people; the versions of their files."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, insert, select, update

from store.database import Repository, insert_if_new, reading, writing
from store.idempotency_and_audit import write_audit
from store.rows import AuditLine, CellRow, CellVersionRow
from store.tables import cell_versions, cells


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


class CellVersionRepository(Repository):
    """Table `cell_versions`. Service and executor both note what they see; the first one makes the version."""

    def note_cell_version(
        self, cell: str, sha256: str, text: bytes, calibration: bytes | None = None, seen_by: str = ""
    ) -> int:
        """Returns the version of a cell whose files are these; a new one where they differ from the newest.

        Args:
            cell: Name of the cell.
            sha256: Hash of its files.
            text: Content of the cell file.
            calibration: Content of its calibration file, if it has one.
            seen_by: Who sees it, such as "service" or "executor".
        """
        with reading(self._engine) as connection:
            newest = _newest(connection, cell)
        while newest is None or newest[1] != sha256:
            row = CellVersionRow(cell, newest[0] + 1 if newest else 1, sha256, text, calibration, time.time(), seen_by)
            with writing(self._engine) as connection:
                connection.execute(insert_if_new(connection, cell_versions, **vars(row)))
                newest = _newest(connection, cell)  # somebody else's, if that was first
        return newest[0]

    def cell_versions(self, cell: str) -> list[CellVersionRow]:
        """Returns the versions of a cell, newest first."""
        query = select(cell_versions).where(cell_versions.c.cell == cell)
        return self._rows(CellVersionRow, query.order_by(cell_versions.c.version.desc()))


def _newest(connection: Connection, cell: str) -> tuple[int, str] | None:
    query = select(cell_versions.c.version, cell_versions.c.sha256).where(cell_versions.c.cell == cell)
    row = connection.execute(query.order_by(cell_versions.c.version.desc()).limit(1)).one_or_none()
    return None if row is None else (row.version, row.sha256)
