"""Throwability maps of a cell: make one, read a plane of it, cancel it."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, Query, Response
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from api import fling_version
from api.dependencies import AnyCaller, IfNoneMatch, PlanCaller, Service, ServiceDep
from api.http import (
    ProblemDetails,
    StrictJsonRoute,
    invalid_field,
    json_answer,
    preferred_media_type,
    problem_answers,
    unchanging,
)
from api.routes.cells import CellName
from api.routes.plans import POST_PROBLEMS, UNCHANGED
from api.schemas import MAP_EXAMPLES, UUID_PATTERN, MapAnswer, MapBody, MapHead
from jobs.maps import (
    MapRequest,
    MapTable,
    OutputUnavailable,
    begin_map,
    map_document,
    map_head,
    map_html,
    map_picture,
    map_table,
    why_void,
    zarr_zip,
)
from store import MapRow

router = APIRouter(route_class=StrictJsonRoute, tags=["maps"])

BINARY = {"schema": {"type": "string", "format": "binary"}}
OFFERS = ("application/json", "image/png", "application/zip", "text/html")
MAP_ANSWER: dict[str, Any] = {
    "model": MapAnswer,
    "content": {"image/png": BINARY, "application/zip": BINARY, "text/html": {"schema": {"type": "string"}}},
    "description": "One plane as JSON; or all planes as PNG, zipped Zarr or HTML, by `Accept`.",
}
MapFields = Annotated[MapBody, Body(openapi_examples=MAP_EXAMPLES)]  # type: ignore[arg-type]
MapId = Annotated[str | None, Query(description="Id of the map; by default the latest.", pattern=UUID_PATTERN)]
MapPlane = Annotated[float | None, Query(ge=-100.0, le=100.0, description="Height of the plane [m]; the closest one.")]
MapRobust = Annotated[bool | None, Query(description="Only maps of robust plans, or only of soonest ones.")]
MapResolution = Annotated[
    float | None, Query(ge=0.001, le=10.0, allow_inf_nan=False, description="Only maps of this resolution [m].")
]
MapAccept = Annotated[str | None, Header(description=", ".join(OFFERS))]


@router.post(
    "/cells/{name}/map",
    status_code=202,
    summary="Make a map",
    responses=json_answer(202, MapHead, "Begun, or resumed; read it at `Location`.", "not-found", *POST_PROBLEMS),
)
async def make_cell_map(name: CellName, body: MapFields, service: ServiceDep, caller: PlanCaller) -> JSONResponse:
    """Plans a throw to every landing cell of a plane or a volume, coarse points first; every yes has a stored plan.

    The same request for an unchanged cell is the same map: a cancelled one resumes, a finished one is returned.
    """

    def begin() -> tuple[MapRow, dict[str, Any]]:
        service.store.require_room()
        source, _ = service.cells.required(name)
        row = begin_map(service.store, source, _request(body), fling_version(), caller.name, "service")
        return row, map_head(_table(service, row))

    row, head = await run_in_threadpool(begin)
    if row.state == "running":
        service.map_drivers.add(row.id)
    return JSONResponse(head, 202, {"Location": f"/cells/{name}/map?id={row.id}"})


@router.get(
    "/cells/{name}/map",
    summary="Read a map",
    responses={200: MAP_ANSWER, **UNCHANGED, **problem_answers("not-found", "not-acceptable", "invalid-request")},
)
def read_cell_map(
    name: CellName,
    service: ServiceDep,
    caller: AnyCaller,
    known: IfNoneMatch,
    id: MapId = None,
    plane_z_m: MapPlane = None,
    robust: MapRobust = None,
    resolution_m: MapResolution = None,
    accept: MapAccept = None,
) -> Response:
    """Reads the latest map of a cell, or another one, as far as it is. One that does not hold any more is `void`."""
    media = preferred_media_type(accept, OFFERS)
    row, void = _find(service, name, id, robust, resolution_m)

    def answer() -> Response:
        return _answer(service, name, _table(service, row), void, media, plane_z_m)

    tag = f"{row.id}-{row.beat_at}-{row.state}-{row.is_worked_on}-{void is None}-{plane_z_m}-{media.rpartition('/')[2]}"
    return unchanging(known, tag, answer)


@router.post(
    "/cells/{name}/map/cancel",
    status_code=202,
    summary="Cancel a map",
    responses=json_answer(202, MapHead, "Its runner stops soon; what is planned stays.", "not-found", *POST_PROBLEMS),
)
def cancel_cell_map(name: CellName, service: ServiceDep, caller: PlanCaller, id: MapId = None) -> JSONResponse:
    """Ends the work on a map; the same request to make it resumes."""
    row, void = _find(service, name, id, None, None)
    service.store.request_map_cancel(row.id)
    now = service.store.map(row.id) or row
    return JSONResponse(map_head(_table(service, now), void), 202)


def _request(body: MapBody) -> MapRequest:
    """Returns what is asked for, in the planner's types."""
    volume = None if body.volume_m is None else (body.volume_m[0], body.volume_m[1])
    extent = None if body.extent_m is None else (*body.extent_m,)
    return MapRequest(body.plane_z_m, volume, body.resolution_m, extent, body.robust)  # type: ignore[arg-type]


def _find(
    service: Service, name: str, id: str | None, robust: bool | None, resolution_m: float | None
) -> tuple[MapRow, str | None]:
    """Returns a map of a cell and why it is void: the newest that holds, else the newest.

    Raises:
        ProblemDetails: There is none.
    """
    service.cell(name)
    listed = service.store.maps_of_cell(name) if id is None else [service.store.map(id)]
    rows = [
        row
        for row in listed
        if (row is not None and row.cell == name)
        and (robust is None or row.definition["robust"] == robust)
        and (resolution_m is None or abs(row.definition["resolution_m"] - resolution_m) < 1e-9)
    ]
    if not rows:
        raise ProblemDetails("not-found", f"no such map of cell {name!r}; POST /cells/{name}/map makes one")
    source = service.cells.source(name)
    judged = ((row, why_void(service.store, row, source)) for row in rows)
    newest = next(judged)
    return newest if newest[1] is None else next((pair for pair in judged if pair[1] is None), newest)


def _answer(
    service: Service, name: str, table: MapTable, void: str | None, media: str, plane_z_m: float | None
) -> Response:
    """Returns a map in a media type.

    Raises:
        ProblemDetails: A library for it is not installed.
    """
    x, y = service.cell(name).X_WB[:2, 3].tolist()
    headers = {"Vary": "Accept"}
    try:
        if media == "image/png":
            return Response(map_picture(table, void, (x, y)).png, headers=headers, media_type=media)
        if media == "application/zip":
            headers["Content-Disposition"] = f'attachment; filename="{name}.zarr.zip"'
            return Response(zarr_zip(table, void), headers=headers, media_type=media)
        if media == "text/html":
            return Response(map_html(table, void, (x, y)), headers=headers, media_type=media)
    except OutputUnavailable as error:
        raise invalid_field("accept", f"{media}: {error}") from None
    planes = table.definition.planes_z_m
    plane = 0 if plane_z_m is None else min(range(len(planes)), key=lambda k: abs(planes[k] - plane_z_m))
    return JSONResponse(map_document(table, void, plane), headers=headers)


def _table(service: Service, row: MapRow) -> MapTable:
    return map_table(row, service.store.landing_cells(row.id))
