"""Executions: queue one, look at it, watch it, brake it."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, Path, Query, Response
from fastapi.responses import JSONResponse, StreamingResponse
from starlette.concurrency import run_in_threadpool

from api.clock import iso
from api.deps import ClientDep, ExecuteKey, OperatorClient, Remote, Service, ServiceDep
from api.documented import json_answer, problems_of
from api.errors import Problem
from api.events import follow
from api.negotiation import choose
from api.plans import find_plan
from api.readiness import check_ready
from api.schemas.executions import ExecutionAnswer, ExecutionList
from api.schemas.requests import EXECUTE_EXAMPLES, ExecuteRequest
from planner.errors import CellError
from store import ExecutionRow, KeyTaken, PlanRow

router = APIRouter(tags=["executions"])

MCAP = "application/octet-stream"  # MCAP has no registered media type
ExecutionId = Annotated[str, Path(description="Id of an execution, or `latest`.", max_length=64, openapi_examples={
    "latest": {"summary": "the newest execution", "value": "latest"}})]  # fmt: skip
ExecuteBody = Annotated[ExecuteRequest, Body(openapi_examples=EXECUTE_EXAMPLES)]  # type: ignore[arg-type]


@router.post(
    "/execute", status_code=202, summary="Execute a plan",
    responses={**json_answer(202, ExecutionAnswer, "Queued."),
               **problems_of("robot-busy", "robot-not-ready", "plan-not-executable", "not-found", "invalid-request",
                             "idempotency-conflict", "too-large", "unsupported-media-type", "unauthenticated",
                             "forbidden")},
)  # fmt: skip
def execute(
    body: ExecuteBody, service: ServiceDep, client: OperatorClient, key: ExecuteKey, remote: Remote
) -> Response:
    """Queues one execution of a plan. **This moves the robot**; software stop is not a safety function."""
    known = None if key is None else service.store.resource_of_key(key)
    if known is not None:
        return _accepted(find_execution(service, known))
    plan = find_plan(service, body.plan_id, whole=False)
    _check_executable(service, plan, body)
    arguments = (plan.id, plan.cell, body.mode, body.dry_run, client.name, key)
    try:
        row = service.store.queue_execution(*arguments)
    except KeyTaken as taken:
        if key is None or taken.body_sha256 != key.body_sha256:
            raise
        return _accepted(find_execution(service, taken.resource_id))
    service.store.add_audit(client.name, "execute", f"/executions/{row.id}", remote)
    return _accepted(row)


@router.get("/executions", summary="List executions", responses=json_answer(200, ExecutionList, "Newest first."))
def list_executions(
    service: ServiceDep,
    client: ClientDep,
    limit: Annotated[int, Query(ge=1, le=200, description="How many at most.")] = 50,
    cursor: Annotated[str | None, Query(description="`next_cursor` of the page before.", max_length=64)] = None,
) -> JSONResponse:
    """Lists executions, newest first."""
    rows, following = service.store.executions(limit, cursor)
    return JSONResponse({"executions": [execution_document(row) for row in rows], "next_cursor": following})


@router.get(
    "/executions/{id}", summary="Read an execution",
    responses={**json_answer(200, ExecutionAnswer, "State, outcome, metrics."), **problems_of("not-found")},
)  # fmt: skip
def read_execution(id: ExecutionId, service: ServiceDep, client: ClientDep) -> JSONResponse:
    """Reads the state, and at the end the outcome and the metrics."""
    return JSONResponse(execution_document(find_execution(service, id)))


@router.get(
    "/executions/{id}/events", summary="Watch an execution",
    responses={200: {"content": {"text/event-stream": {"schema": {"type": "string"}}},
                     "description": "Events `state`, `telemetry`, `note`; ends when the execution has."},
               **problems_of("not-found", "invalid-request")},
)  # fmt: skip
async def watch_execution(
    id: ExecutionId,
    service: ServiceDep,
    client: ClientDep,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Resume after this event.")] = 0,
) -> StreamingResponse:
    """Streams state changes and telemetry (20 Hz or more) as server-sent events until the execution has ended."""
    row = await run_in_threadpool(find_execution, service, id)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(follow(service.store, row.id, last_event_id), 200, headers, "text/event-stream")


@router.get(
    "/executions/{id}/recording", summary="Download the recording",
    responses={200: {"content": {MCAP: {"schema": {"type": "string", "format": "binary"}},
                                 "text/csv": {"schema": {"type": "string"}}},
                     "description": "Planned against measured, one row a tick: MCAP, or CSV by `Accept`."},
               **problems_of("not-found")},
)  # fmt: skip
def read_recording(
    id: ExecutionId,
    service: ServiceDep,
    client: ClientDep,
    accept: Annotated[str | None, Header(description="application/octet-stream (MCAP) or text/csv.")] = None,
) -> Response:
    """Downloads what was planned, sent and measured, one row a tick."""
    row = find_execution(service, id)
    recording = service.store.recording(row.id)
    if recording is None:
        raise Problem("not-found", f"execution {row.id!r} has no recording" + ("" if row.outcome else " yet"))
    wants_csv = choose(accept, (MCAP, "text/csv")) == "text/csv"
    content, media, ending = (recording.csv, "text/csv", "csv") if wants_csv else (recording.mcap, MCAP, "mcap")
    disposition = f'attachment; filename="fling-{row.id}.{ending}"'
    return Response(content, 200, {"Content-Disposition": disposition, "Vary": "Accept"}, media)


@router.post(
    "/executions/{id}/abort", status_code=202, summary="Brake now",
    responses={**json_answer(202, ExecutionAnswer, "The executor brakes."), **problems_of("not-found")},
)  # fmt: skip
def abort(id: ExecutionId, service: ServiceDep, client: ClientDep, remote: Remote) -> JSONResponse:
    """Asks the executor to brake; any valid token may. **Not a safety function**: use the emergency stop."""
    row = service.store.request_abort(find_execution(service, id).id)
    service.store.add_audit(client.name, "abort", f"/executions/{row.id}", remote)
    return JSONResponse(execution_document(row), 202)


def find_execution(service: Service, id: str) -> ExecutionRow:
    """Returns an execution by its id or `latest`.

    Raises:
        Problem: there is none.
    """
    if id == "latest":
        newest, _ = service.store.executions(limit=1)
        id = newest[0].id if newest else id
    row = service.store.execution(id)
    if row is None:
        raise Problem("not-found", f"no execution {id!r}")
    return row


def execution_document(row: ExecutionRow) -> dict[str, Any]:
    """Returns an execution as it is answered."""
    times = {name: iso(value) for name, value in vars(row).items() if name.endswith("_at")}
    document = {**vars(row), **times, "metrics": None if row.metrics is None else dict(row.metrics)}
    del document["executor_id"]
    return document


def _accepted(row: ExecutionRow) -> JSONResponse:
    return JSONResponse(execution_document(row), 202, {"Location": f"/executions/{row.id}"})


def _check_executable(service: Service, plan: PlanRow, body: ExecuteRequest) -> None:
    """Refuses what cannot run now; the executor judges all of it again.

    Raises:
        Problem: the cell changed, or its executor or robot is not ready.
    """
    try:
        cell = service.shelf.cell(plan.cell)
    except CellError as error:
        raise Problem("plan-not-executable", f"the cell file is refused now: {error}") from error
    if cell is None or cell.sha256 != plan.cell_sha256:
        change = "is gone" if cell is None else "has changed since"
        raise Problem("plan-not-executable", f"the cell file {plan.cell!r} {change}: plan again", cell=plan.cell)
    real = cell.link.kind != "sim"
    if real and not service.tokens:
        raise Problem("forbidden", "a service without tokens executes on simulated cells alone")
    if real and body.plan_id == "latest":
        raise Problem("forbidden", "on a real arm a plan is executed by its own id, not by 'latest'")
    check_ready(service.store.cell_status(plan.cell), plan.cell)
