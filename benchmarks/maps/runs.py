"""Runs of a map in a process of its own, killed on the way or not, and what it has planned."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jobs.maps import MapRequest, MapTable, begin_map, map_table
from planner.cell import CellSource
from store import Store

POLL_S = 0.2  # [s] between two looks at how far the map is


@dataclass(frozen=True, eq=False)
class MapMeasurement:
    """One map and how it came about.

    Attributes:
        table: the map.
        url: of its store.
        levels_s: distance of the points of each level [m], and when it was completed, from the start on [s].
        duration_s: of all runs together [s].
        kills: answers that were stored when the process was killed.
        store_bytes: size of the store.
    """

    table: MapTable
    url: str
    levels_s: tuple[tuple[float, float], ...]
    duration_s: float
    kills: tuple[int, ...]
    store_bytes: int


def run_map(
    folder: Path, source: CellSource, request: MapRequest, version: str, workers: int, kill_at: Sequence[float] = ()
) -> MapMeasurement:
    """Makes a map in an empty store.

    Args:
        folder: of the store.
        source: content of the cell's files.
        request: what the map is to show.
        version: of Fling.
        workers: number of planner processes.
        kill_at: shares of the answers [-], ascending; when a share is stored, the process is killed with SIGKILL, and
            begun again.
    """
    file = folder / "map.db"
    url = f"sqlite:///{file}"
    store = Store.open(url)
    row = begin_map(store, source, request, version, "benchmark")
    total = map_table(row, []).definition.count
    levels: dict[float, float] = {}
    kills = []
    begun_s = time.monotonic()
    for share in [*kill_at, 2.0]:
        process = subprocess.Popen(
            [sys.executable, "-m", "jobs", "map", row.id, "--workers", str(workers)],
            env={**os.environ, "FLING_DATABASE_URL": url},
        )
        while process.poll() is None:
            time.sleep(POLL_S)
            done = store.landing_cell_count(row.id)
            _note_level(store, row.id, levels, time.monotonic() - begun_s)
            if done >= share * total:
                process.kill()
                process.wait()
                kills.append(done)
    _note_level(store, row.id, levels, time.monotonic() - begun_s)
    table = map_table(store.map(row.id) or row, store.landing_cells(row.id))
    store.close()
    duration = time.monotonic() - begun_s
    return MapMeasurement(table, url, tuple(levels.items()), duration, tuple(kills), file.stat().st_size)


def _note_level(store: Store, map_id: str, levels: dict[float, float], at_s: float) -> None:
    """Notes when the finest completed level was first seen."""
    row = store.map(map_id)
    if row is not None:
        level = map_table(row, store.landing_cells(map_id)).level_m
        if level is not None:
            levels.setdefault(level, at_s)
