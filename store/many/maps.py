"""Throwability maps: their definitions, and the answer of each landing cell with its plan."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, func, insert, select, update

from store.database import Repository, insert_if_new, writing
from store.rows import new_id
from store.tables import landing_cells, maps, plans

MAP_FRESH_S = 60.0  # [s] answers of a map are stored every second; a landing cell takes a few seconds at most


@dataclass(frozen=True)
class MapRow:
    """One throwability map.

    Attributes:
        made_by: Who makes it: "service" or "command".
        definition: What it is of, as JSON; see `batch.maps`.
        state: "running", "finished" or "cancelled".
        beat_at: When its last answers were stored.
    """

    id: str
    created_at: float
    cell: str
    cell_version: int
    created_by: str
    made_by: str
    definition_sha256: str
    definition: Mapping[str, Any]
    state: str
    beat_at: float | None = None
    cancel_requested_at: float | None = None
    finished_at: float | None = None

    @property
    def is_worked_on(self) -> bool:
        """Whether it is running, and answers were stored within `MAP_FRESH_S`."""
        return self.state == "running" and time.time() - (self.beat_at or 0.0) < MAP_FRESH_S


@dataclass(frozen=True)
class LandingCellRow:
    """The answer of one landing cell of a map.

    Attributes:
        map_id: The map.
        number: Of the landing cell.
        round: In which it was answered: 0 by its own search, later from the releases of its neighbours.
        state: 1 planned, 2 refused with proof, 3 not found; see `batch.maps`.
        plan_id: Its plan.
        samples_sha256: Hash of the plan's trajectory.
        release_time_s: Of the plan.
        shift_early_m, shift_late_m: How far the landing point moves for a release 10 ms early, or late.
        hit_probability: Of the plan [-].
        margin, margin_check: Least margin of the certificate as a share of its limit [-], and which check has it.
        constraint_name, reason: Why it is refused: which constraint, and by how much.
    """

    map_id: str
    number: int
    round: int
    state: int
    plan_id: str | None = None
    samples_sha256: str | None = None
    release_time_s: float | None = None
    shift_early_m: float | None = None
    shift_late_m: float | None = None
    hit_probability: float | None = None
    margin: float | None = None
    margin_check: str | None = None
    constraint_name: str | None = None
    reason: str | None = None


@dataclass(frozen=True)
class MapPlan:
    """A plan of a landing cell, as the store takes it; see `PlanRow`."""

    id: str
    cell: str
    cell_sha256: str
    backend: str
    summary: bytes
    samples: bytes


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

    def add_landing_cells(self, map_id: str, rows: Sequence[LandingCellRow], made: Sequence[MapPlan]) -> bool:
        """Stores answers with their plans, all or none; an answer replaces an earlier one of its landing cell.

        Returns:
            Whether somebody asked to cancel the map.
        """
        numbers, now = [row.number for row in rows], time.time()
        of_map = landing_cells.c.map_id == map_id
        with writing(self._engine) as connection:
            for plan in made:
                values = {**vars(plan), "created_at": now, "document": b"", "request_id": None}
                connection.execute(insert_if_new(connection, plans, **values))
            connection.execute(delete(landing_cells).where(of_map, landing_cells.c.number.in_(numbers)))
            if rows:
                connection.execute(insert(landing_cells), [dict(vars(row)) for row in rows])
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
