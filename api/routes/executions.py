"""Executions: queue, list, read, watch, abort, download the recording."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Annotated, Any

import orjson
from anyio import to_thread
from fastapi import APIRouter, Body, Header, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from starlette.concurrency import run_in_threadpool

from api.dependencies import (
    PLAIN,
    AnyCaller,
    Key,
    OperateCaller,
    Origin,
    Service,
    ServiceDep,
    find,
    id_in_path,
    make_once,
)
from api.http import (
    Caller,
    ProblemDetails,
    StrictJsonRoute,
    event_stream,
    event_stream_answer,
    json_answer,
    preferred_media_type,
    problem_answers,
)
from api.routes.plans import POST_PROBLEMS, PageCursor, PageLimit, find_plan
from api.schemas import (
    EXECUTE_EXAMPLES,
    REPLACE_EXAMPLES,
    ExecuteRequest,
    ExecutionAnswer,
    ExecutionList,
    Outcome,
    ReplaceRequest,
    StateEvent,
    TargetEvent,
    TelemetryEvent,
    iso_time,
)
from fling import tracing
from planner.cell import NAME_PATTERN, Cell
from planner.errors import CellError
from store import AuditLine, CellRow, ExecutionRow, PlanRow

router = APIRouter(route_class=StrictJsonRoute, tags=["executions"])

UNGUARDED = "a service without tokens executes on simulated cells only"
MOVING = ("velocities", "accelerations")  # of a plan's start: not zero where it joins a motion
REPLACE_S = 10.0  # [s] longest wait for the executor: it certifies the plan, and brakes it from every row
ASK_S = 0.01  # [s] between two looks for its answer
MCAP = "application/octet-stream"  # MCAP has no registered media type
ExecutionId = Annotated[str, id_in_path("execution")]
ReplaceBody = Annotated[ReplaceRequest, Body(openapi_examples=REPLACE_EXAMPLES)]  # type: ignore[arg-type]
ExecuteBody = Annotated[ExecuteRequest, Body(openapi_examples=EXECUTE_EXAMPLES)]  # type: ignore[arg-type]
OfCell = Annotated[str | None, Query(pattern=f"^{NAME_PATTERN.pattern}$", description="Only those of this cell.")]
OfOutcome = Annotated[Outcome | None, Query(description="Only those that ended so.")]
RECORDING_ANSWER = {
    "content": {MCAP: {"schema": {"type": "string", "format": "binary"}}, "text/csv": {"schema": {"type": "string"}}},
    "description": "Planned and measured motion, one row per tick: MCAP, or CSV by `Accept`.",
}
EVENT_STREAM_ANSWER = event_stream_answer(
    "State changes, telemetry and what becomes of a tracked target; ends with the execution.",
    state=StateEvent,
    telemetry=TelemetryEvent,
    target=TargetEvent,
)


@router.post(
    "/execute",
    status_code=202,
    summary="Execute a plan",
    responses={
        **json_answer(202, ExecutionAnswer, "Queued.", *POST_PROBLEMS, "not-found"),
        **problem_answers("robot-busy", "robot-not-ready", "plan-not-executable"),
    },
)
def execute_plan(body: ExecuteBody, service: ServiceDep, caller: OperateCaller, key: Key, origin: Origin) -> Response:
    """Queues one execution of a plan. **This moves the robot**; software stop is not a safety function."""

    def queue() -> str:
        service.store.require_room()
        plan = find_plan(service, body.plan_id, whole=False)
        check_executable(service, plan, body.plan_id)
        if any(any(orjson.loads(plan.summary)["request"].get("start", {}).get(name, ())) for name in MOVING):
            detail = "the plan starts in motion: it can only replace a running one (POST /executions/{id}/replace)"
            raise ProblemDetails("plan-not-executable", detail, cell=plan.cell)
        return service.store.queue_execution(
            plan.id,
            plan.cell,
            body.mode,
            body.dry_run,
            caller.name,
            key,
            body.experiment_id,
            origin.act(caller, "execute"),
            tracing.trace_context(),
        ).id

    row = find_execution(service, make_once(service.store, key, queue))
    return JSONResponse(_document(service, row), 202, {"Location": f"/executions/{row.id}"})


@router.get("/executions", summary="List executions", responses=json_answer(200, ExecutionList, "Newest first."))
def list_executions(
    service: ServiceDep,
    caller: AnyCaller,
    limit: PageLimit = 50,
    cursor: PageCursor = None,
    cell: OfCell = None,
    outcome: OfOutcome = None,
) -> JSONResponse:
    """Lists executions, newest first: all of them, or those of a cell or with an outcome."""
    rows, following = service.store.executions(limit, cursor, cell, outcome)
    return JSONResponse({"executions": [_document(service, row) for row in rows], "next_cursor": following})


@router.get(
    "/executions/{id}",
    summary="Read an execution",
    responses=json_answer(200, ExecutionAnswer, "State, outcome, metrics.", "not-found"),
)
def read_execution(id: ExecutionId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads the state of an execution, and after its end the outcome and the metrics."""
    return JSONResponse(_document(service, find_execution(service, id)))


@router.get(
    "/executions/{id}/recording",
    summary="Download the recording",
    responses={200: RECORDING_ANSWER, **problem_answers("not-found", "not-acceptable")},
    response_class=Response,
)
def read_recording(
    id: ExecutionId,
    service: ServiceDep,
    caller: AnyCaller,
    accept: Annotated[str | None, Header(description="application/octet-stream (MCAP) or text/csv.")] = None,
) -> Response:
    """Downloads the planned, sent and measured motion, one row per tick."""
    wants_csv = preferred_media_type(accept, (MCAP, "text/csv")) == "text/csv"
    row = find_execution(service, id)
    recording = service.store.recording(row.id)
    if recording is None:
        raise ProblemDetails("not-found", f"execution {row.id!r} has no recording" + ("" if row.outcome else " yet"))
    content, media, suffix = (recording.csv, "text/csv", "csv") if wants_csv else (recording.mcap, MCAP, "mcap")
    disposition = f'attachment; filename="fling-{row.id}.{suffix}"'
    return Response(content, 200, {"Content-Disposition": disposition, "Vary": "Accept"}, media)


@router.get(
    "/executions/{id}/events",
    summary="Watch an execution",
    response_class=StreamingResponse,
    responses={200: EVENT_STREAM_ANSWER, **problem_answers("not-found", "invalid-request")},
)
async def watch_execution(
    id: ExecutionId,
    request: Request,
    service: ServiceDep,
    caller: AnyCaller,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Resume after this event."), PLAIN] = 0,
) -> StreamingResponse:
    """Streams state changes and telemetry (20 Hz or more) as server-sent events until the execution has ended."""
    row = await run_in_threadpool(find_execution, service, id)
    return event_stream(service.feeds.listen(row.id, last_event_id), request.state.is_allowed)


@router.post(
    "/executions/{id}/replace",
    status_code=202,
    summary="Go on with another plan",
    responses={
        **json_answer(202, ExecutionAnswer, "The plan joins the motion.", *POST_PROBLEMS, "not-found"),
        **problem_answers("cannot-join", "robot-not-ready", "plan-not-executable"),
    },
)
def replace_plan(
    id: ExecutionId, body: ReplaceBody, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Replaces a running plan by one that begins on it, at the tick at which it does. **This moves the robot.**

    The executor certifies it with its own cell file, and takes it if it joins in position, velocity and acceleration
    and its tick can still be reached; otherwise the running plan goes on untouched, and `detail` says why. Not in
    script mode.
    """
    row = find_execution(service, id)
    plan = find_plan(service, body.plan_id, whole=False)
    row = join_plan(service, row, plan, body.plan_id, caller.name, origin.act(caller, "replace"))
    return JSONResponse(_document(service, row), 202, {"Location": f"/executions/{row.id}"})


def join_plan(
    service: Service, row: ExecutionRow, plan: PlanRow, asked_for: str, who: str, audit: AuditLine
) -> ExecutionRow:
    """Has the executor go on with a plan; returns the execution once it has taken it.

    Args:
        service: the service.
        row: the running execution.
        plan: begins on its motion.
        asked_for: id of the plan in the request, or `latest`.
        who: asks.
        audit: what is noted of it.

    Raises:
        ProblemDetails: The running plan goes on untouched.
    """
    check_executable(service, plan, asked_for)
    if plan.cell != row.cell:
        raise ProblemDetails("cannot-join", f"the plan is for cell {plan.cell!r}, the execution runs on {row.cell!r}")
    if row.state in ("queued", "preparing", "finished"):
        raise ProblemDetails("cannot-join", f"the execution is {row.state}: there is no motion to join")
    asked = service.store.request_replacement(row.id, plan.id, who, audit)
    if asked is None:
        raise ProblemDetails("cannot-join", "it has ended, or another plan that is to replace it is being certified")
    row, answer = _replacement(service, row.id, asked)
    if answer is None:
        what = "the execution has ended" if row.state == "finished" else "the executor did not answer yet"
        raise ProblemDetails("cannot-join", f"{what}: see 'replacements' of the execution")
    if answer["joins_s"] is None:
        raise ProblemDetails("cannot-join", answer["reason"])
    return row


@router.post(
    "/executions/{id}/abort",
    status_code=202,
    summary="Brake now",
    responses=json_answer(202, ExecutionAnswer, "The executor brakes.", "not-found", "executor-lost"),
)
async def abort_execution(
    id: ExecutionId, request: Request, service: ServiceDep, caller: AnyCaller, origin: Origin
) -> JSONResponse:
    """Requests a brake; any valid token may. **Not a safety function**: use the emergency stop.

    The executor of this machine is asked directly, and is answered for while the database does not answer.
    `latest` is the newest execution; without the database the newest that runs.
    """
    stopping = service.stopping
    audit = origin.act(caller, "abort")
    wanted = await stopping.newest() if id == "latest" else id
    running = await stopping.at_executor(wanted, caller.name)
    if running is not None:  # its executor brakes: all else may wait
        row = await stopping.in_store_soon(running.id, audit) or running
        return JSONResponse(_row_document(row, False), 202)
    if (ended := await stopping.ended(wanted or id)) is not None:  # nothing is left to brake, and to wait for
        row = await stopping.in_store_soon(ended.id, audit) or ended
    else:
        row = await stopping.in_store(wanted or id, audit)
    document = await to_thread.run_sync(_document, service, row, limiter=request.app.state.lanes.stops)
    if document["executor_lost"]:
        detail = f"the executor of cell {row.cell!r} does not report: nobody brakes; use the emergency stop"
        raise ProblemDetails("executor-lost", detail, cell=row.cell, execution_id=row.id, state=row.state)
    return JSONResponse(document, 202)


def find_execution(service: Service, id: str) -> ExecutionRow:
    """Returns an execution by its id or `latest`.

    Raises:
        ProblemDetails: There is no such execution.
    """
    return find("execution", id, service.store.execution, service.store.executions)


def _document(service: Service, row: ExecutionRow) -> dict[str, Any]:
    """Returns the JSON of an execution."""
    return _row_document(row, _executor_is_lost(service, row))


def _row_document(row: ExecutionRow, is_lost: bool) -> dict[str, Any]:
    document = {name: iso_time(value) if name.endswith("_at") else value for name, value in vars(row).items()}
    del document["executor_id"]
    del document["replace_request"]
    return {**document, "replacements": row.replacements or [], "executor_lost": is_lost}


def _replacement(service: Service, id: str, request_id: str) -> tuple[ExecutionRow, Mapping[str, Any] | None]:
    """Waits for the answer to a request for a replacement; returns the execution with it, None where there is none."""
    ends_s = time.monotonic() + REPLACE_S
    while True:
        row = find_execution(service, id)
        answer = next((each for each in row.replacements or () if each["id"] == request_id), None)
        if answer is not None or row.state == "finished" or time.monotonic() > ends_s:
            return row, answer
        time.sleep(ASK_S)


def _executor_is_lost(service: Service, row: ExecutionRow) -> bool:
    """Returns whether nobody carries an unfinished execution: its executor is silent, or another has replaced it."""
    if row.state == "finished":
        return False
    status = service.store.cell_status(row.cell)
    return status is None or not status.is_alive or row.executor_id not in (None, status.executor_id)


def check_executable(service: Service, plan: PlanRow, asked_for: str) -> None:
    """Refuses a plan that cannot be executed now; the executor checks all of it again.

    Args:
        service: the service.
        plan: that is to be executed.
        asked_for: its id in the request, or `latest`.

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
    if plan.sha256 is None:
        detail = "an earlier version of Fling stored the plan, without a hash of its content: plan again"
        raise ProblemDetails("plan-not-executable", detail, cell=plan.cell)
    adopted = service.store.profile_in_use(plan.cell, plan.cell_sha256)
    made = orjson.loads(plan.summary).get("profile")
    if made != (None if adopted is None else adopted.id):
        detail = f"the plan was made with profile {made}, the cell uses {adopted and adopted.id}: plan again"
        raise ProblemDetails("plan-not-executable", detail, cell=plan.cell, profile=adopted and adopted.id)
    real = cell.link.kind != "sim"
    if real and not service.tokens.is_guarded:
        raise ProblemDetails("forbidden", UNGUARDED)
    if real and asked_for == "latest":
        raise ProblemDetails("forbidden", "on a real arm a plan is executed by its own id, not by 'latest'")
    row = service.store.cell_status(plan.cell)
    reason = _reason_not_ready(row, plan.cell)
    if reason is not None:
        raise ProblemDetails("robot-not-ready", reason, cell=plan.cell, fault=None if row is None else row.fault)


def reason_not_executable(service: Service, caller: Caller, cell: Cell, row: CellRow | None) -> str | None:
    """Returns why an execution that `caller` asks for now would be refused; None where it would be queued."""
    if "operate" not in caller.scopes:
        return "this token may not execute: it lacks the scope 'operate'"
    if cell.link.kind != "sim" and not service.tokens.is_guarded:
        return UNGUARDED
    return _reason_not_ready(row, cell.name)


def _reason_not_ready(row: CellRow | None, cell: str) -> str | None:
    if row is None:
        return f"cell {cell!r} has no executor: start one with 'fling executor --cell {cell}'"
    if not row.is_alive:
        silent_s = time.time() - row.heartbeat_at
        return f"the executor of cell {cell!r} has not reported for {silent_s:.0f} s: it has ended, or is stalled"
    if row.read_only:
        return f"the executor of cell {cell!r} does not move its robot (--read-only)"
    if row.fault is not None:
        reason = row.fault.get("reason", row.fault)
        return f"a fault is latched: {reason}; check the robot, then acknowledge it (`fling acknowledge`)"
    return None
