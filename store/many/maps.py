"""Throwability maps: their definitions, and the answer of each landing cell with its plan."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import delete, func, insert, select, update

from store.database import Repository, insert_if_new, writing
from store.plans import insert_plan_if_new
from store.rows import LandingCellRow, MapRow, PlanRow, new_id
from store.tables import landing_cells, maps


class MapRepository(Repository):
    """Tables `maps` and `landing_cells`."""

    def begin_map(
        self, cell: str, cell_version: int, sha256: str, definition: Mapping[str, Any], who: str, made_by: str
    ) -> MapRow:
        """Returns the map of a definition, which is running from now on: the one that was begun before, or a new one.

        Args:
            cell: Name of the cell.
            cell_version: Version of its files.
            sha256: Hash of the definition.
            definition: As JSON.
            who: Asks for it.
            made_by: Who makes it: "service" or "command".
        """
        values = {"id": new_id(), "created_at": time.time(), "cell": cell, "cell_version": cell_version}
        values |= {"created_by": who, "definition_sha256": sha256, "definition": dict(definition)}
        values |= {"state": "running", "made_by": made_by}
        resumed = update(maps).where(maps.c.definition_sha256 == sha256, maps.c.state == "cancelled")
        with writing(self._engine) as connection:
            connection.execute(insert_if_new(connection, maps, **values))
            connection.execute(resumed.values(state="running", made_by=made_by, cancel_requested_at=None))
            beat = update(maps).where(maps.c.definition_sha256 == sha256, maps.c.state == "running")
            connection.execute(beat.values(beat_at=time.time()))
            found = connection.execute(select(maps).where(maps.c.definition_sha256 == sha256)).one()
        return MapRow(**found._mapping)

    def map(self, id: str) -> MapRow | None:
        """Returns one map."""
        return self._row(MapRow, select(maps).where(maps.c.id == id))

    def maps_of_cell(self, cell: str, limit: int = 200) -> list[MapRow]:
        """Returns the maps of a cell, newest first."""
        query = select(maps).where(maps.c.cell == cell)
        return self._rows(MapRow, query.order_by(maps.c.id.desc()).limit(limit))

    def running_maps(self, made_by: str) -> list[MapRow]:
        """Returns the maps that are running, oldest first; nobody may work on one, see `MapRow.is_worked_on`."""
        query = select(maps).where(maps.c.state == "running", maps.c.made_by == made_by)
        return self._rows(MapRow, query.order_by(maps.c.id))

    def beat_maps(self, ids: Sequence[str]) -> None:
        """Says that maps are taken care of, as those are that wait in line."""
        if ids:
            with writing(self._engine) as connection:
                connection.execute(update(maps).where(maps.c.id.in_(ids)).values(beat_at=time.time()))

    def landing_cells(self, map_id: str) -> list[LandingCellRow]:
        """Returns the answers of a map so far, in the order of their numbers."""
        query = select(landing_cells).where(landing_cells.c.map_id == map_id)
        return self._rows(LandingCellRow, query.order_by(landing_cells.c.number))

    def landing_cell_count(self, map_id: str) -> int:
        """Returns how many landing cells of a map have an answer."""
        query = select(func.count()).select_from(landing_cells).where(landing_cells.c.map_id == map_id)
        return int(self._value(query) or 0)

    def add_landing_cells(self, map_id: str, rows: Sequence[LandingCellRow], made: Sequence[PlanRow]) -> bool:
        """Stores answers with their plans, all or none; an answer replaces an earlier one of its landing cell.

        Returns:
            Whether somebody asked to cancel the map.
        """
        numbers = [row.number for row in rows]
        now = time.time()
        of_map = landing_cells.c.map_id == map_id
        with writing(self._engine) as connection:
            for plan in made:
                insert_plan_if_new(connection, plan)
            connection.execute(delete(landing_cells).where(of_map, landing_cells.c.number.in_(numbers)))
            if rows:
                connection.execute(insert(landing_cells), [vars(row) for row in rows])
            beat = update(maps).where(maps.c.id == map_id).values(beat_at=now)
            asked = connection.execute(beat.returning(maps.c.cancel_requested_at)).scalar_one_or_none()
        return asked is not None

    def end_map(self, map_id: str, state: str) -> None:
        """Records that a map is `finished`, or `cancelled`: that nobody works on it."""
        ended = {"state": state, "finished_at": time.time() if state == "finished" else None}
        with writing(self._engine) as connection:
            running = update(maps).where(maps.c.id == map_id, maps.c.state == "running")
            connection.execute(running.values(cancel_requested_at=None, **ended))

    def request_map_cancel(self, map_id: str) -> None:
        """Asks whoever works on a map to cancel it."""
        with writing(self._engine) as connection:
            running = update(maps).where(maps.c.id == map_id, maps.c.state == "running")
            connection.execute(running.values(cancel_requested_at=time.time()))
