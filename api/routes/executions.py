"""Executions: queue, list, read, abort, download the recording."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, Path, Response
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, ExecuteKey, OperateCaller, RemoteAddress, Service, ServiceDep
from api.http import ProblemDetails, json_answer, preferred_media_type, problem_answers
from api.liveness import check_ready
from api.routes.plans import PageCursor, PageLimit, find_plan
from api.schemas import EXECUTE_EXAMPLES, ExecuteRequest, ExecutionAnswer, ExecutionList, iso_time
from planner.errors import CellError
from store import ExecutionRow, KeyTaken, PlanRow

router = APIRouter(tags=["executions"])

MCAP = "application/octet-stream"  # MCAP has no registered media type
ExecutionId = Annotated[
    str,
    Path(
        description="Id of an execution, or `latest`.",
        max_length=64,
        openapi_examples={"latest": {"summary": "the newest execution", "value": "latest"}},
    ),
]
ExecuteBody = Annotated[ExecuteRequest, Body(openapi_examples=EXECUTE_EXAMPLES)]  # type: ignore[arg-type]
RECORDING_ANSWER = {
    "content": {MCAP: {"schema": {"type": "string", "format": "binary"}}, "text/csv": {"schema": {"type": "string"}}},
    "description": "Planned and measured motion, one row per tick: MCAP, or CSV by `Accept`.",
}


@router.post(
    "/execute",
    status_code=202,
    summary="Execute a plan",
    responses={
        **json_answer(202, ExecutionAnswer, "Queued."),
        **problem_answers(
            "robot-busy",
            "robot-not-ready",
            "plan-not-executable",
            "not-found",
            "invalid-request",
            "idempotency-conflict",
            "too-large",
            "unsupported-media-type",
            "unauthenticated",
            "forbidden",
        ),
    },
)
def execute(
    body: ExecuteBody, service: ServiceDep, caller: OperateCaller, key: ExecuteKey, remote: RemoteAddress
) -> Response:
    """Queues one execution of a plan. **This moves the robot**; software stop is not a safety function."""
    existing = None if key is None else service.store.resource_of_key(key)
    if existing is not None:
        return _accepted(find_execution(service, existing))
    plan = find_plan(service, body.plan_id, whole=False)
    _check_executable(service, plan, body)
    try:
        row = service.store.queue_execution(plan.id, plan.cell, body.mode, body.dry_run, caller.name, key)
    except KeyTaken as taken:
        if key is None or taken.body_sha256 != key.body_sha256:
            raise
        return _accepted(find_execution(service, taken.resource_id))
    service.store.add_audit(caller.name, "execute", f"/executions/{row.id}", remote)
    return _accepted(row)


@router.get("/executions", summary="List executions", responses=json_answer(200, ExecutionList, "Newest first."))
def list_executions(
    service: ServiceDep, caller: AnyCaller, limit: PageLimit = 50, cursor: PageCursor = None
) -> JSONResponse:
    """Lists executions, newest first."""
    rows, following = service.store.executions(limit, cursor)
    return JSONResponse({"executions": [execution_document(row) for row in rows], "next_cursor": following})


@router.get(
    "/executions/{id}",
    summary="Read an execution",
    responses={**json_answer(200, ExecutionAnswer, "State, outcome, metrics."), **problem_answers("not-found")},
)
def read_execution(id: ExecutionId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads the state of an execution, and after its end the outcome and the metrics."""
    return JSONResponse(execution_document(find_execution(service, id)))


@router.get(
    "/executions/{id}/recording",
    summary="Download the recording",
    responses={200: RECORDING_ANSWER, **problem_answers("not-found")},
)
def read_recording(
    id: ExecutionId,
    service: ServiceDep,
    caller: AnyCaller,
    accept: Annotated[str | None, Header(description="application/octet-stream (MCAP) or text/csv.")] = None,
) -> Response:
    """Downloads the planned, sent and measured motion, one row per tick."""
    row = find_execution(service, id)
    recording = service.store.recording(row.id)
    if recording is None:
        raise ProblemDetails("not-found", f"execution {row.id!r} has no recording" + ("" if row.outcome else " yet"))
    wants_csv = preferred_media_type(accept, (MCAP, "text/csv")) == "text/csv"
    content, media, suffix = (recording.csv, "text/csv", "csv") if wants_csv else (recording.mcap, MCAP, "mcap")
    disposition = f'attachment; filename="fling-{row.id}.{suffix}"'
    return Response(content, 200, {"Content-Disposition": disposition, "Vary": "Accept"}, media)


@router.post(
    "/executions/{id}/abort",
    status_code=202,
    summary="Brake now",
    responses={**json_answer(202, ExecutionAnswer, "The executor brakes."), **problem_answers("not-found")},
)
def abort(id: ExecutionId, service: ServiceDep, caller: AnyCaller, remote: RemoteAddress) -> JSONResponse:
    """Requests a brake; any valid token may. **Not a safety function**: use the emergency stop."""
    row = service.store.request_abort(find_execution(service, id).id)
    service.store.add_audit(caller.name, "abort", f"/executions/{row.id}", remote)
    return JSONResponse(execution_document(row), 202)


def find_execution(service: Service, id: str) -> ExecutionRow:
    """Returns an execution by its id or `latest`.

    Raises:
        ProblemDetails: There is no such execution.
    """
    if id == "latest":
        newest, _ = service.store.executions(limit=1)
        id = newest[0].id if newest else id
    row = service.store.execution(id)
    if row is None:
        raise ProblemDetails("not-found", f"no execution {id!r}")
    return row


def execution_document(row: ExecutionRow) -> dict[str, Any]:
    """Returns the JSON of an execution."""
    times = {name: iso_time(value) for name, value in vars(row).items() if name.endswith("_at")}
    document = {**vars(row), **times, "metrics": None if row.metrics is None else dict(row.metrics)}
    del document["executor_id"]
    return document


def _accepted(row: ExecutionRow) -> JSONResponse:
    return JSONResponse(execution_document(row), 202, {"Location": f"/executions/{row.id}"})


def _check_executable(service: Service, plan: PlanRow, body: ExecuteRequest) -> None:
    """Refuses an execution that cannot start now; the executor checks all of it again.

    Raises:
        ProblemDetails: The cell has changed, or its executor or robot is not ready.
    """
    try:
        cell = service.cells.cell(plan.cell)
    except CellError as error:
        raise ProblemDetails("plan-not-executable", f"the cell file is refused now: {error}") from error
    if cell is None or cell.sha256 != plan.cell_sha256:
        change = "is gone" if cell is None else "has changed since planning"
        raise ProblemDetails("plan-not-executable", f"the cell file {plan.cell!r} {change}: plan again", cell=plan.cell)
    real = cell.link.kind != "sim"
    if real and not service.tokens:
        raise ProblemDetails("forbidden", "a service without tokens executes on simulated cells only")
    if real and body.plan_id == "latest":
        raise ProblemDetails("forbidden", "on a real arm a plan is executed by its own id, not by 'latest'")
    check_ready(service.store.cell_status(plan.cell), plan.cell)
