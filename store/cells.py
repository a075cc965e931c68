"""Cells: their executors with heartbeats; latched faults, acknowledged by people; the versions of their files."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, select, update

from store.database import Repository, insert_if_new, reading, writing
from store.idempotency_and_audit import write_audit
from store.rows import AuditLine, CellRow, CellVersionRow, new_id
from store.tables import cell_versions, cells


class CellStatusRepository(Repository):
    """Table `cells`."""

    def take_cell(self, cell: str, executor_id: str, link_kind: str, held_by: str, seen: CellRow | None = None) -> bool:
        """Makes an executor the one of a cell: the only one whose heartbeats and claims count from now on.

        No clock decides: whoever has seen for long enough that a holder's heartbeats have ended takes its place, unless
        another one came meanwhile.

        Args:
            cell: Name of the cell.
            executor_id: Of the executor.
            link_kind: Of the cell.
            held_by: Where the executor runs, in words.
            seen: The last heartbeat of a holder that has ended; None: nobody holds the cell.

        Returns:
            Whether it holds the cell now.
        """
        now = time.time()
        values = {"executor_id": executor_id, "heartbeat_at": now, "link_kind": link_kind, "held_by": held_by}
        fresh = {**values, "cell": cell, "robot": {}, "read_only": False}
        is_free = cells.c.held_by.is_(None)
        if seen is not None:
            is_free |= (cells.c.executor_id == seen.executor_id) & (cells.c.heartbeat_at == seen.heartbeat_at)
        with writing(self._engine) as connection:
            connection.execute(update(cells).where(cells.c.cell == cell, is_free).values(**values))
            connection.execute(insert_if_new(connection, cells, **fresh))
            holder = select(cells.c.executor_id).where(cells.c.cell == cell)
            return connection.execute(holder).scalar_one() == executor_id

    def leave_cell(self, cell: str, executor_id: str) -> None:
        """Gives a cell up, for the next executor to take at once."""
        with writing(self._engine) as connection:
            own = update(cells).where(cells.c.cell == cell, cells.c.executor_id == executor_id)
            connection.execute(own.values(held_by=None))

    def record_heartbeat(
        self,
        cell: str,
        executor_id: str,
        link_kind: str,
        robot: Mapping[str, Any] | None = None,
        fault: Mapping[str, Any] | None = None,
        read_only: bool = False,
    ) -> bool:
        """Records a heartbeat of the cell's executor with the robot's state and the latched fault, if any.

        Returns:
            False where the executor does not hold the cell, or no longer: nothing is recorded.
        """
        values = {"heartbeat_at": time.time(), "link_kind": link_kind}
        values |= {"robot": dict(robot or {}), "fault": None if fault is None else dict(fault), "read_only": read_only}
        with writing(self._engine) as connection:
            own = update(cells).where(cells.c.cell == cell, cells.c.executor_id == executor_id)
            return bool(connection.execute(own.values(**values)).rowcount)

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

    def request_robot_action(self, cell: str, action: str, who: str, audit: AuditLine | None = None) -> None:
        """Records that a person asks the cell's executor to operate its robot; a newer request replaces an older one.

        Args:
            cell: Name of the cell.
            action: One of `RobotAction`.
            who: The person.
            audit: Line of the audit trail.
        """
        request = {"id": new_id(), "action": action, "requested_by": who, "requested_at": time.time()}
        with writing(self._engine) as connection:
            connection.execute(update(cells).where(cells.c.cell == cell).values(robot_request=request))
            write_audit(connection, audit, f"/cells/{cell}")

    def answer_robot_request(self, cell: str, request_id: str, done: bool, text: str) -> None:
        """Records what became of a request to operate the robot."""
        answer = {"id": request_id, "done": done, "text": text}
        with writing(self._engine) as connection:
            connection.execute(update(cells).where(cells.c.cell == cell).values(robot_answer=answer))


class CellVersionRepository(Repository):
    """Table `cell_versions`. Service and executor both note what they see; the first one makes the version."""

    def note_cell_version(
        self,
        cell: str,
        sha256: str,
        text: bytes,
        calibration: bytes | None = None,
        seen_by: str = "",
        meshes: bytes | None = None,
    ) -> int:
        """Returns the version of a cell whose files are these; a new one where they differ from the newest.

        Args:
            cell: Name of the cell.
            sha256: Hash of its files.
            text: Content of the cell file.
            calibration: Content of its calibration file, if it has one.
            seen_by: Who sees it, such as "service" or "executor".
            meshes: What became of the mesh files that it names.
        """
        with reading(self._engine) as connection:
            newest = _newest(connection, cell)
        while newest is None or newest[1] != sha256:
            number = newest[0] + 1 if newest else 1
            row = CellVersionRow(cell, number, sha256, text, calibration, time.time(), seen_by, meshes)
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
