"""A map as the JSON of `/cells/{name}/map`: its head, and with one plane of it, for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from jobs.maps.landing_cells import LandingState
from jobs.maps.table import MapTable


def map_head(table: MapTable, void: str | None = None, plane: int = 0) -> dict[str, Any]:
    """Returns what a map is of and how far it is, as JSON.

    Args:
        table: the map.
        void: why it does not hold any more; None where it does.
        plane: index of the plane.
    """
    row = table.row
    definition = table.definition
    return {
        "id": row.id,
        "cell": row.cell,
        "cell_version": row.cell_version,
        "cell_sha256": definition.cell_sha256,
        "profile": definition.profile,
        "planner_version": definition.planner_version,
        "robust": definition.robust,
        "plane_z_m": definition.planes_z_m[plane],
        "planes_z_m": list(definition.planes_z_m),
        "resolution_m": definition.resolution_m,
        "origin": list(definition.origin_m),
        "shape": list(definition.shape),
        "state": state_word(table, void),
        "void_because": void,
        "level_m": table.level_m,
        "progress": {"done": table.answered, "total": definition.count},
        "counts": {state.name.lower(): table.count_of(state) for state in LandingState},
        "sha256": table.sha256,
    }


def map_document(table: MapTable, void: str | None = None, plane: int = 0) -> dict[str, Any]:
    """Returns one plane of a map as JSON: its head, and the values of its landing cells.

    Args:
        table: the map.
        void: why it does not hold any more; None where it does.
        plane: index of the plane.
    """
    return {
        **map_head(table, void, plane),
        "values": {
            "state": table.state[plane].tolist(),
            "release_time_s": _nulls(table.measures["release_time_s"][plane]),
            "landing_shift_10ms_m": _nulls(table.landing_shift_m[plane]),
            "hit_probability": _nulls(table.measures["hit_probability"][plane]),
            "margin": _nulls(table.measures["margin"][plane]),
            "reason": [[None if index < 0 else index for index in line] for line in table.reason[plane].tolist()],
        },
        "reasons": [{"constraint": constraint, "text": text} for constraint, text in table.reasons],
        "plans": [[id or None for id in line] for line in table.plan_ids[plane].tolist()],
    }


def state_word(table: MapTable, void: str | None) -> str:
    """Returns what is the matter with a map: void, running, waiting for someone to work on it, finished, cancelled."""
    if void is not None:
        return "void"
    if table.row.state == "running" and not table.row.is_worked_on:
        return "waiting"
    return table.row.state


def _nulls(values: np.ndarray) -> list[list[float | None]]:
    """Returns numbers with null for NaN."""
    return [[None if value != value else value for value in line] for line in values.tolist()]
