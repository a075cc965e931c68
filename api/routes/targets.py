"""Tracked targets: observe one again and again, read what is known of it; plans name it by its id."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Body, Response
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, Key, OperateCaller, Origin, Service, ServiceDep, id_in_path, make_once
from api.http import ProblemDetails, StrictJsonRoute, invalid_field, invalid_fields, json_answer, problem_answers
from api.routes.cells import CellName
from api.routes.landings import check_place
from api.routes.plans import POST_PROBLEMS, controller_time_s
from api.schemas import (
    OBSERVATION_EXAMPLES,
    TARGET_EXAMPLES,
    ObservationRequest,
    TrackedTargetAnswer,
    TrackedTargetList,
    TrackedTargetRequest,
    iso_time,
)
from planner.cell import Cell
from planner.releases.target import TARGET_SPEED_MAX_M_S
from planner.tracking import ObservationRefused, TargetObservation, TargetTrack
from store import TrackedTargetRow

router = APIRouter(route_class=StrictJsonRoute, tags=["targets"])

FUTURE_S = 1.0  # [s] an observation may be ahead of the controller's time as the service knows it: a heartbeat, a link
READ_PROBLEMS = ("not-found", "unauthenticated")
TargetId = Annotated[str, id_in_path("target")]
TargetBody = Annotated[TrackedTargetRequest, Body(openapi_examples=TARGET_EXAMPLES)]  # type: ignore[arg-type]
ObservationBody = Annotated[ObservationRequest, Body(openapi_examples=OBSERVATION_EXAMPLES)]  # type: ignore[arg-type]


@router.post(
    "/cells/{name}/targets",
    status_code=201,
    summary="Track a target",
    responses=json_answer(201, TrackedTargetAnswer, "As first observed.", *POST_PROBLEMS, "not-found"),
)
def track_target(
    name: CellName, body: TargetBody, service: ServiceDep, caller: OperateCaller, key: Key, origin: Origin
) -> JSONResponse:
    """Begins to track a target with its first observation. Plans name it: `"position": {"target": id}`.

    A Kalman filter of constant velocity joins the observations. The 100 targets of a cell that were observed last
    are kept, for an hour after their last observation.
    """
    cell = service.cell(name)
    seen = _observation(service, cell, body)

    def make() -> str:
        track = TargetTrack.begun(seen, body.drift_m_s)
        return service.store.add_target(name, track.as_document(), caller.name, key, origin.act(caller, "target")).id

    row = service.store.target(name, make_once(service.store, key, make))
    return JSONResponse(_document(row), 201, {"Location": f"/cells/{name}/targets/{row.id}"})


@router.get(
    "/cells/{name}/targets",
    summary="List tracked targets",
    responses=json_answer(200, TrackedTargetList, "Newest first.", *READ_PROBLEMS),
)
def list_targets(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists the tracked targets of a cell, newest first, each as of its last observation."""
    service.cells.required(name)
    rows = service.store.targets_of_cell(name)
    return JSONResponse({"cell": name, "targets": [_document(row) for row in rows]})


@router.get(
    "/cells/{name}/targets/{id}",
    summary="Read a tracked target",
    responses=json_answer(200, TrackedTargetAnswer, "As of its last observation.", *READ_PROBLEMS),
)
def read_target(name: CellName, id: TargetId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads place and velocity of a target, and how well they are known, as of its last observation."""
    return JSONResponse(_document(service.store.target(name, _id_of(service, name, id))))


@router.post(
    "/cells/{name}/targets/{id}/observations",
    status_code=201,
    summary="Observe a target",
    responses=json_answer(201, TrackedTargetAnswer, "With this observation.", *POST_PROBLEMS, "not-found"),
)
def observe_target(
    name: CellName, id: TargetId, body: ObservationBody, service: ServiceDep, caller: OperateCaller
) -> JSONResponse:
    """Adds an observation to what is known of a target.

    One that is no later than the last, or farther from what was predicted than five standard deviations, is refused,
    and changes nothing.
    """
    cell = service.cell(name)
    seen = _observation(service, cell, body)

    def change(track: Mapping[str, Any]) -> Mapping[str, Any]:
        return TargetTrack.from_document(track).observed(seen).as_document()

    try:
        row = service.store.change_target(name, _id_of(service, name, id), change)
    except ObservationRefused as refused:
        raise invalid_field(refused.field, str(refused)) from refused
    return JSONResponse(_document(row), 201, {"Location": f"/cells/{name}/targets/{row.id}"})


@router.delete(
    "/cells/{name}/targets/{id}",
    status_code=204,
    summary="Forget a target",
    responses=problem_answers("not-found", "unauthenticated", "forbidden"),
    response_class=Response,
)
def forget_target(name: CellName, id: TargetId, service: ServiceDep, caller: OperateCaller, origin: Origin) -> Response:
    """Forgets a target. Plans that were made for it hold its numbers and stay as they are."""
    service.store.delete_target(name, _id_of(service, name, id), origin.act(caller, "forget-target"))
    return Response(status_code=204)


def _id_of(service: Service, cell: str, id: str) -> str:
    """Returns the id of a target of a cell, given that or `latest`.

    Raises:
        UnknownCell: There is no such cell.
    """
    service.cells.required(cell)
    if id != "latest":
        return id
    return next((row.id for row in service.store.targets_of_cell(cell)), id)


def _observation(service: Service, cell: Cell, body: ObservationRequest) -> TargetObservation:
    """Returns an observation that was checked against the cell and its controller's time.

    Raises:
        ProblemDetails: The place is too far away, the velocity not level or too fast, or the time has not come yet.
    """
    check_place(cell, body.position)
    errors = [] if body.velocity is None else _velocity_errors(body.velocity)
    try:
        now_s = controller_time_s(service, cell.name)
    except ProblemDetails:  # no executor: nothing to compare with
        now_s = math.inf
    if body.observed_at_s > now_s + FUTURE_S:
        reason = f"{body.observed_at_s:.12g} s is {body.observed_at_s - now_s:.3g} s ahead of the controller's clock"
        errors.append({"field": "observed_at_s", "reason": reason})
    if errors:
        raise invalid_fields(errors)
    x, y, z = body.position
    velocity = None if body.velocity is None else (body.velocity[0], body.velocity[1], 0.0)
    return TargetObservation((x, y, z), body.std_m, body.observed_at_s, velocity, body.velocity_std_m_s)


def _velocity_errors(velocity: Sequence[float]) -> list[dict[str, str]]:
    if velocity[2] != 0.0:
        return [{"field": "velocity[2]", "reason": f"{velocity[2]:g} m/s is not 0: a target moves on a level"}]
    if (speed := math.hypot(*velocity)) > TARGET_SPEED_MAX_M_S:
        return [{"field": "velocity", "reason": f"{speed:g} m/s is above {TARGET_SPEED_MAX_M_S:g} m/s"}]
    return []


def _document(row: TrackedTargetRow) -> dict[str, Any]:
    """Returns the JSON of a tracked target."""
    about = {"id": row.id, "cell": row.cell, "created_at": iso_time(row.created_at), "created_by": row.created_by}
    return {**about, **row.track}
