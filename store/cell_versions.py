"""Versions of the cell files: what each was, from when on it was seen; never changed."""

from __future__ import annotations

import time

from sqlalchemy import Connection, select
from sqlalchemy.dialects import postgresql, sqlite

from store.database import Repository, reading, writing
from store.rows import CellVersionRow
from store.tables import cell_versions


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
                insert = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}[connection.dialect.name]
                connection.execute(insert(cell_versions).values(**vars(row)).on_conflict_do_nothing())
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
