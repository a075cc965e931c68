"""Tracked targets: observe one again and again, read what is known of it; plans name it by its id."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Body
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from api.dependencies import AnyCaller, Key, OperateCaller, Origin, Service, ServiceDep, id_in_path, make_once
from api.http import ProblemDetails, StrictJsonRoute, invalid_field, invalid_fields, json_answer
from api.routes.cells import CellName
from api.routes.following import follow_target
from api.routes.landings import check_place
from api.routes.plans import POST_PROBLEMS, controller_time_s, tracked_id
from api.schemas import (
    OBSERVATION_EXAMPLES,
    TARGET_EXAMPLES,
    ObservationRequest,
    TrackedTargetAnswer,
    TrackedTargetList,
    TrackedTargetRequest,
    iso_time,
)
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
    seen = _observation(service, name, body)

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
    return JSONResponse(_document(service.store.target(name, tracked_id(service, name, id))))


@router.post(
    "/cells/{name}/targets/{id}/observations",
    status_code=201,
    summary="Observe a target",
    responses=json_answer(201, TrackedTargetAnswer, "With this observation.", *POST_PROBLEMS, "not-found"),
)
async def observe_target(
    name: CellName, id: TargetId, body: ObservationBody, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Adds an observation to what is known of a target. **May change or stop a throw at it.**

    One that is no later than the last, or farther from what was predicted than five standard deviations, is refused,
    and changes nothing of what is known. A throw at the target that waits for its start is planned again where the
    target will pass elsewhere; one in motion that would miss is stopped while the object is still held, also where it
    is a refused observation that says so.
    """
    seen = await run_in_threadpool(_observation, service, name, body)
    try:
        row = await run_in_threadpool(_observed, service, name, id, seen)
    except ObservationRefused as refused:
        if refused.contradicts:
            known = await run_in_threadpool(lambda: service.store.target(name, tracked_id(service, name, id)))
            await follow_target(service, known, caller, origin, contradicting=seen)
        raise invalid_field(refused.field, str(refused)) from refused
    await follow_target(service, row, caller, origin)
    return JSONResponse(_document(row), 201, {"Location": f"/cells/{name}/targets/{row.id}"})


def _observed(service: Service, name: str, id: str, seen: TargetObservation) -> TrackedTargetRow:
    """Returns a target with a further observation.

    Raises:
        ObservationRefused: it does not fit.
        UnknownRow: The cell has no such target.
    """

    def change(track: Mapping[str, Any]) -> Mapping[str, Any]:
        return TargetTrack.from_document(track).observed(seen).as_document()

    return service.store.change_target(name, tracked_id(service, name, id), change)


@router.delete(
    "/cells/{name}/targets/{id}",
    summary="Forget a target",
    responses=json_answer(200, TrackedTargetAnswer, "As it was last known.", *READ_PROBLEMS, "forbidden"),
)
def forget_target(
    name: CellName, id: TargetId, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Forgets a target. Plans that were made for it hold its numbers and stay as they are."""
    row = service.store.delete_target(name, tracked_id(service, name, id), origin.act(caller, "forget-target"))
    return JSONResponse(_document(row))


def _observation(service: Service, name: str, body: ObservationRequest) -> TargetObservation:
    """Returns an observation that was checked against the cell and its controller's time.

    Raises:
        ProblemDetails: The place is too far away, the velocity not level or too fast, or the time has not come yet.
    """
    check_place(service.cell(name), body.position)
    errors = [] if body.velocity is None else _velocity_errors(body.velocity)
    try:
        now_s = controller_time_s(service, name)
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
