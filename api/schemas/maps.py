"""Bodies of `/cells/{name}/map`: what a throwability map is to show, and one plane of it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.schemas.requests import Number, RequestModel

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Extent = Annotated[list[Number], Field(min_length=4, max_length=4)]


class MapBody(RequestModel):
    """What a map is to show."""

    plane_z_m: Number | None = Field(None, description="Height of the plane [m]; by default the floor of the cell.")
    volume_m: Pair | None = Field(None, description="Lowest and highest plane [m], a resolution apart.")
    resolution_m: Number = Field(0.05, description="Edge of a landing cell [m], 0.005 to 2.")
    extent_m: Extent | None = Field(
        None, description="[x0, x1, y0, y1] [m]; by default all that is not proven to be out of the arm's range."
    )
    robust: bool = Field(False, description="Plans with a target's release window; false: those that release soonest.")


class MapProgress(BaseModel):
    """How many landing cells have an answer."""

    done: int
    total: int


class MapHead(BaseModel):
    """A map and its progress."""

    id: str
    cell: str
    cell_version: int = Field(description="Version of the cell's files that it was made with.")
    cell_sha256: str
    profile: str | None = Field(description="Profile that it was made with; null: the cell file's numbers.")
    planner_version: str = Field(description="Version of Fling that it was made with.")
    robust: bool
    plane_z_m: float = Field(description="Height of the plane that is shown [m].")
    planes_z_m: list[float] = Field(description="Heights of all planes [m].")
    resolution_m: float = Field(description="Edge of a landing cell [m].")
    origin: list[float] = Field(description="Centre of landing cell 0, 0: x, y [m].")
    shape: list[int] = Field(description="Landing cells along y, along x.")
    state: str = Field(
        description="running; waiting: its runner starts or has died, and the service or the same POST resumes it; "
        "cancelled: on request, or because some landing cells' searches were cut off; the same POST resumes it; "
        "finished; void: see `void_because`."
    )
    void_because: str | None = Field(description="Why the map does not hold any more; null where it does.")
    level_m: float | None = Field(description="Distance of the points of the finest completed level [m].")
    progress: MapProgress = Field(description="Landing cells of all planes.")
    counts: dict[str, int] = Field(description="Landing cells of all planes: unknown, yes, proven, not_found.")
    sha256: str = Field(description="Hash of all answers; equal for equal maps.")


class MapValues(BaseModel):
    """Values of the landing cells, each a row along x for every y."""

    state: list[list[int]] = Field(description="0 unknown, 1 yes, 2 refused with proof, 3 not found.")
    release_time_s: list[list[float | None]] = Field(description="Release time of the plan [s].")
    landing_shift_10ms_m: list[list[float | None]] = Field(
        description="How far the landing point moves for a release 10 ms early or late, whichever is farther [m]."
    )
    hit_probability: list[list[float | None]] = Field(description="With what is known of the cell [-].")
    margin: list[list[float | None]] = Field(description="Least margin of the certificate as a share of its limit [-].")
    reason: list[list[int | None]] = Field(description="Index into `reasons`.")


class MapReason(BaseModel):
    """Why landing cells are refused."""

    constraint: str = Field(description="Name of the certificate's check, or of the planner's bound.")
    text: str = Field(description="By how much.")


class MapAnswer(MapHead):
    """One plane of a throwability map."""

    values: MapValues
    reasons: list[MapReason]
    plans: list[list[str | None]] = Field(description="Ids of the stored plans.")


MAP_EXAMPLES: dict[str, Any] = {
    "soonest": {
        "summary": "three by three metres of the floor",
        "value": {"extent_m": [-1.5, 1.5, -1.5, 1.5], "resolution_m": 0.05},
    },
    "coarse": {"summary": "all within range, coarse", "value": {"resolution_m": 0.5}},
    "robust": {
        "summary": "a table's height, robust plans",
        "value": {"plane_z_m": 0.7, "extent_m": [0.3, 1.3, -0.5, 0.5], "resolution_m": 0.1, "robust": True},
    },
}
