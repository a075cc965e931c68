"""From what a person asks for to a map that is begun: of the cell as it is, with the profile that it uses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from jobs.maps.definition import DECIMALS, RESOLUTION_M, MapDefinition, definition_from, landing_grid
from jobs.maps.driven import MapInputs
from jobs.maps.table import void_because
from learning import cell_in_use
from planner.cell import Cell, CellSource, cell_of
from planner.errors import FieldError, InvalidProblem
from planner.problem import TargetRelease, ThrowProblem
from planner.refusal import farthest_target_m, shoulder_position
from store import MapRow, Store


@dataclass(frozen=True)
class MapRequest:
    """What a map is to show.

    Attributes:
        plane_z_m: height of the plane [m]; None: the floor of the cell.
        volume_m: heights of the lowest and the highest plane of a volume [m]; None: the one plane.
        resolution_m: edge of a landing cell, and distance of two planes [m].
        extent_m: least and largest x, least and largest y [m]; None: all that the planner does not prove out of range.
        robust: whether plans have a target's default release window; otherwise they release soonest.
    """

    plane_z_m: float | None = None
    volume_m: tuple[float, float] | None = None
    resolution_m: float = RESOLUTION_M
    extent_m: tuple[float, float, float, float] | None = None
    robust: bool = False


def begin_map(
    store: Store, source: CellSource, request: MapRequest, planner_version: str, who: str, made_by: str = "command"
) -> MapRow:
    """Returns the map of a request for a cell as it is now: the one that was begun before, or a new one.

    Args:
        store: knows the profile that the cell uses.
        source: content of the cell's files.
        request: what the map is to show.
        planner_version: version of Fling.
        who: asks for it.
        made_by: who makes it: "service" or "command".

    Raises:
        InvalidProblem: every field that is out of its bounds.
        CellError: the cell file is refused.
    """
    cell, profile = cell_in_use(store, cell_of(source))
    definition = map_definition(cell, source.sha256, profile, request, planner_version)
    version = store.note_cell_version(source.name, source.sha256, source.text, source.calibration, who, source.meshes)
    return store.begin_map(source.name, version, definition.sha256, definition.document(), who, made_by)


def map_definition(
    cell: Cell, sha256: str, profile: str | None, request: MapRequest, planner_version: str
) -> MapDefinition:
    """Returns what a map is of.

    Args:
        cell: the robot station, with its profile's numbers.
        sha256: hash of its files.
        profile: id of its profile; None: the cell file's numbers.
        request: what the map is to show.
        planner_version: version of Fling.

    Raises:
        InvalidProblem: every field that is out of its bounds.
    """
    if request.plane_z_m is not None and request.volume_m is not None:
        raise InvalidProblem([FieldError("volume_m", "a map has one plane or a volume, not both")])
    floor = cell.surroundings.floor_z_m if request.plane_z_m is None else request.plane_z_m
    heights = (floor,) if request.volume_m is None else request.volume_m
    extent = request.extent_m or (0.0, 1.0, 0.0, 1.0)
    landing_grid(extent, request.resolution_m, heights)  # checks the numbers before they are reckoned with
    if request.extent_m is None:
        extent = _within_range(cell, heights[0], request.resolution_m)
    planes, origin, shape = landing_grid(extent, request.resolution_m, heights)
    settings = (planes, origin, shape, request.resolution_m, request.robust)
    return MapDefinition(cell.name, sha256, profile, planner_version, *settings)


def map_inputs(store: Store, row: MapRow) -> MapInputs:
    """Returns what the plans of a map are made for: the cell and the profile that its definition names.

    Args:
        store: has them.
        row: the map.
    """
    version = next(each for each in store.cell_versions(row.cell) if each.version == row.cell_version)
    id = row.definition["profile"]
    profile = None if id is None else store.profile(id)
    source = CellSource(row.cell, version.text, version.calibration, version.meshes)
    return MapInputs(source, None if profile is None else (profile.id, profile.document))


def why_void(store: Store, row: MapRow, source: CellSource | None) -> str | None:
    """Returns why a map does not hold any more, in words; None where it does.

    Args:
        store: knows the profile that the cell uses.
        row: the map.
        source: content of the cell's files now; None: they are gone.
    """
    definition = definition_from(row.definition)
    profile = None if source is None else store.profile_in_use(row.cell, source.sha256)
    return void_because(definition, None if source is None else source.sha256, None if profile is None else profile.id)


def _within_range(cell: Cell, z_m: float, resolution_m: float) -> tuple[float, float, float, float]:
    """Returns the square around the shoulder outside of which no throw lands on a plane, in whole landing cells [m].

    What the planner proves of reach, speed and flight depends on a target's distance from the shoulder and on its
    height alone. Lower planes have a longer range.

    Raises:
        InvalidProblem: nothing on the plane is within range.
    """
    x, y, _ = shoulder_position(cell)
    target = TargetRelease(np.array([x, y, z_m]))
    problem = ThrowProblem(cell, cell.home, target, cell.limits)
    range_m = farthest_target_m(problem)
    if range_m is None:
        reason = f"no throw lands {z_m:g} m high: it is out of the arm's range, proven"
        raise InvalidProblem([FieldError("plane_z_m", reason)])
    low = [math.floor((at - range_m) / resolution_m) * resolution_m for at in (x, y)]
    high = [math.ceil((at + range_m) / resolution_m) * resolution_m for at in (x, y)]
    return round(low[0], DECIMALS), round(high[0], DECIMALS), round(low[1], DECIMALS), round(high[1], DECIMALS)
