"""Landings: report where the object of an execution landed, list the reports."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Body
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, Key, OperateCaller, Origin, Service, ServiceDep, id_in_path
from api.http import (
    ProblemDetails,
    StrictJsonRoute,
    invalid_field,
    invalid_fields,
    json_answer,
    problem_answers,
)
from api.routes.executions import ExecutionId, find_execution
from api.routes.plans import POST_PROBLEMS
from api.schemas import LANDING_EXAMPLES, LandingAnswer, LandingList, LandingRequest, iso_time
from planner.cell import FARTHEST_M, Cell
from planner.errors import CellError
from store import ExecutionRow, KeyTaken, LandingRow, new_id

router = APIRouter(route_class=StrictJsonRoute, tags=["executions"])

OWN_SOURCES = ("sim-camera",)  # written by executors alone
NOT_THROWN_YET = ("queued", "preparing", "approaching")  # states
LandingId = Annotated[str, id_in_path("landing")]
LandingBody = Annotated[LandingRequest, Body(openapi_examples=LANDING_EXAMPLES)]  # type: ignore[arg-type]


@router.post(
    "/executions/{id}/landing",
    status_code=201,
    summary="Report a landing",
    responses={
        **json_answer(201, LandingAnswer, "Stored; several are allowed.", *POST_PROBLEMS),
        **problem_answers("not-found", "nothing-thrown"),
    },
)
def report_landing(
    id: ExecutionId, body: LandingBody, service: ServiceDep, caller: OperateCaller, key: Key, origin: Origin
) -> JSONResponse:
    """Stores where the object landed, or whether it hit. Learning weighs every observation by its uncertainty."""
    existing = None if key is None else service.store.resource_of_key(key)
    if existing is not None:
        return _created(service.store.landing(existing))
    if body.source in OWN_SOURCES:
        raise invalid_field("source", f"{body.source!r} is what the executor of a simulated cell reports")
    row = find_execution(service, id)
    cell = _cell_of(service, row)
    _check_reportable(cell, row, id)
    check_place(cell, body.position or [])
    try:
        landing = service.store.add_landing(
            new_id(),
            row.id,
            time.time(),
            reported_by=caller.name,
            key=key,
            audit=origin.act(caller, "landing"),
            **body.model_dump(),
        )
    except KeyTaken as taken:
        return _created(service.store.landing(taken.resource_of(key)))
    return _created(landing)


@router.get(
    "/executions/{id}/landing",
    summary="Read the landings",
    responses=json_answer(200, LandingList, "Oldest first.", "not-found"),
)
def read_landings(id: ExecutionId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists the observations of a throw's landing, withdrawn ones too: these have `withdrawn_at` and count nowhere."""
    row = find_execution(service, id)
    rows = service.store.landings(row.id, withdrawn=True)
    return JSONResponse({"execution_id": row.id, "landings": [landing_document(landing) for landing in rows]})


@router.post(
    "/executions/{id}/landing/{landing}/withdraw",
    summary="Withdraw a landing",
    responses={
        **json_answer(200, LandingAnswer, "It is kept, and counts nowhere.", "not-found", "unauthenticated"),
        **problem_answers("forbidden", "invalid-request"),
    },
)
def withdraw_landing(
    id: ExecutionId, landing: LandingId, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Withdraws a report that was wrong: of another throw or place. Profiles that rest on it stay as they are."""
    row = find_execution(service, id)
    known = [seen.id for seen in service.store.landings(row.id, withdrawn=True)]
    wanted = known[-1] if landing == "latest" and known else landing
    if wanted not in known:
        raise ProblemDetails("not-found", f"execution {row.id!r} has no landing {landing!r}")
    withdrawn = service.store.withdraw_landing(wanted, caller.name, origin.act(caller, "withdraw"))
    assert withdrawn is not None  # it is known
    return JSONResponse(landing_document(withdrawn))


def landing_document(row: LandingRow) -> dict[str, Any]:
    """Returns the JSON of an observation."""
    return {**vars(row), "at": iso_time(row.at), "withdrawn_at": iso_time(row.withdrawn_at)}


def _created(row: LandingRow | None) -> JSONResponse:
    assert row is not None  # retention deletes no young throw, and keys with their landings
    return JSONResponse(landing_document(row), 201, {"Location": f"/executions/{row.execution_id}/landing"})


def _check_reportable(cell: Cell | None, row: ExecutionRow, id: str) -> None:
    """Refuses the landing of an execution that threw nothing, and `latest` on a real arm.

    Raises:
        ProblemDetails: It does.
    """
    if (why := _nothing_thrown(row)) is not None:
        raise ProblemDetails("nothing-thrown", why)
    if id == "latest" and (cell is None or cell.link.kind != "sim"):
        raise ProblemDetails("forbidden", "on a real arm a landing is reported by the execution's own id, not 'latest'")


def _nothing_thrown(row: ExecutionRow) -> str | None:
    """Returns why an execution threw nothing; None where it did, or may have."""
    if row.dry_run:
        return f"execution {row.id} was a dry run, in which nothing moves"
    if row.state in NOT_THROWN_YET:
        return f"execution {row.id} is {row.state}: report its landing once it has thrown"
    if row.outcome == "refused" or (row.outcome == "aborted" and row.metrics is None):
        return f"execution {row.id} was {row.outcome}: {row.reason or 'nothing moved'}"
    if row.metrics is not None and not row.metrics.get("released"):
        return f"in execution {row.id} the gripper was not commanded to open"
    return None


def _cell_of(service: Service, row: ExecutionRow) -> Cell | None:
    """Returns the cell of an execution as its file is now, None where that is gone or refused."""
    try:
        return service.cells.cell(row.cell)
    except CellError:
        return None


def check_place(cell: Cell | None, position: Sequence[float]) -> None:
    """Refuses a place that no arm throws to, which is most likely one in millimetres.

    Raises:
        ProblemDetails: Coordinates are that far from the arm's base; from the world's origin without a cell.
    """
    base = np.zeros(3) if cell is None else cell.X_WB[:3, 3]
    reason = f"m is {FARTHEST_M:g} m or more from the arm: places are in metres"
    errors = [
        {"field": f"position[{i}]", "reason": f"{value:g} {reason}"}
        for i, (value, origin) in enumerate(zip(position, base, strict=False))
        if abs(value - origin) >= FARTHEST_M
    ]
    if errors:
        raise invalid_fields(errors)
