"""Plans: create, list, read, draw."""

from __future__ import annotations

import asyncio
import csv
import io
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import orjson
from fastapi import APIRouter, Body, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from api import fling_version
from api.dependencies import (
    PLAIN,
    AnyCaller,
    Gone,
    IfNoneMatch,
    Key,
    Origin,
    PlanCaller,
    Service,
    ServiceDep,
    find,
    id_in_path,
)
from api.field_errors import named_as_sent
from api.http import (
    EVENTS,
    ProblemAnswer,
    ProblemDetails,
    StrictJsonRoute,
    event_stream,
    event_stream_answer,
    invalid_field,
    json_answer,
    preferred_media_type,
    problem_answers,
    translate,
    unchanging,
)
from api.plan_events import plan_events
from api.planning import ClientGone, PlanningEnded, PlanningQueueFull
from api.running_motion import RunningMotion, running_motion
from api.scene import plan_curves
from api.schemas import (
    PLAN_EXAMPLES,
    UUID_PATTERN,
    PlanAnswer,
    PlanCurves,
    PlanList,
    PlanPreview,
    PlanProgress,
    PlanRequestBody,
    TrajectoryAnswer,
)
from fling import plan_svg, tracing
from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import PoolBroken
from planner.cell import Cell
from planner.errors import CellError, InvalidProblem, PlannerError
from planner.problem import UNCERTAIN_DEVIATIONS
from planner.progress import Observer
from planner.request import target_moves, tracked_targets, with_states
from planner.tracking import TargetTrack
from planner.trajectory import Trajectory
from store import IdempotencyKey, KeyTaken, PlanRow, ProfileRow, UnknownRow, new_id

router = APIRouter(route_class=StrictJsonRoute, tags=["plans"])

TOKEN_PROBLEMS = ("unauthenticated", "forbidden")
POST_PROBLEMS = (*TOKEN_PROBLEMS, "invalid-request", "too-large", "unsupported-media-type")
SEARCH_PROBLEMS = ("not-found", "robot-not-ready", "infeasible", "overloaded", "solver-failed")
START_IN_S = 2.0  # [s] to plan a throw at a target that moves, verify it and start: 1 s on a quiet machine
PlanId = Annotated[str, id_in_path("plan")]
PageLimit = Annotated[int, Query(ge=1, le=200, description="Maximum length of the page."), PLAIN]
PageCursor = Annotated[str | None, Query(description="`next_cursor` of the page before.", pattern=UUID_PATTERN)]
WithTrajectory = Annotated[bool, Query(description="false leaves the trajectory out.")]
WithStore = Annotated[
    bool, Query(description="false: answer and forget. 200, without id and `Location`; not executable.")
]
WithProfile = Annotated[
    str | None,
    Query(description="With `store=false`: as if this profile of the cell were adopted.", pattern=UUID_PATTERN),
]
PlanBody = Annotated[PlanRequestBody, Body(openapi_examples=PLAN_EXAMPLES)]  # type: ignore[arg-type]
UNCHANGED: dict[int | str, dict[str, Any]] = {304: {"description": "The client has it: `If-None-Match`."}}
EVENTS_ANSWER = event_stream_answer(
    "Solved and certified, not stored: `?store=false`. Or the events of a search, by `Accept`.",
    progress=PlanProgress,
    plan=PlanAnswer,
    problem=ProblemAnswer,
)
TRAJECTORY_ANSWER = {
    "model": TrajectoryAnswer,
    "content": {"text/csv": {"schema": {"type": "string"}}},
    "description": "JSON, or CSV with one row per tick, by `Accept`.",
}


@router.post(
    "/plan",
    status_code=201,
    summary="Plan a throw",
    responses={
        200: {"model": PlanPreview, **EVENTS_ANSWER},
        **json_answer(201, PlanAnswer, "Solved, certified and stored."),
        **problem_answers(*POST_PROBLEMS, *SEARCH_PROBLEMS, "not-acceptable"),
    },
)
async def make_plan(
    body: PlanBody,
    service: ServiceDep,
    caller: PlanCaller,
    key: Key,
    origin: Origin,
    gone: Gone,
    request: Request,
    trajectory: WithTrajectory = True,
    store: WithStore = True,
    profile: WithProfile = None,
    accept: Annotated[str | None, Header(description=f"application/json or {EVENTS}.")] = None,
) -> Response:
    """Solves, certifies and stores one plan. A plan that fails its certificate is never stored and never returned.

    As `text/event-stream` the answer is 200: the progress of the search, several times a second, and at the end the
    plan, or the problem. A client that leaves ends its search.
    """
    if store and profile is not None:
        raise invalid_field("profile", "belongs to store=false: a stored plan is of the profile that the cell uses")
    make = _preview if not store else _stored
    asked = PlanOrder(body, service, key, origin.request_id, gone, trajectory, profile)
    if preferred_media_type(accept, ("application/json", EVENTS)) == EVENTS:
        return event_stream(plan_events(request, partial(make, asked)), request.state.is_allowed)
    return await make(asked)


@router.get("/plans", summary="List plans", responses=json_answer(200, PlanList, "Newest first, without trajectories."))
def list_plans(service: ServiceDep, caller: AnyCaller, limit: PageLimit = 50, cursor: PageCursor = None) -> Response:
    """Lists plans, newest first, without their trajectories."""
    rows, following = service.store.plans(limit, cursor)
    page = b'{"plans":[' + b",".join(row.summary for row in rows) + b'],"next_cursor":' + orjson.dumps(following) + b"}"
    return Response(page, media_type="application/json")


@router.get(
    "/plans/{id}",
    summary="Read a plan",
    responses={**UNCHANGED, **json_answer(200, PlanAnswer, "As it was stored.", "not-found")},
)
def read_plan(
    id: PlanId, service: ServiceDep, caller: AnyCaller, known: IfNoneMatch, trajectory: WithTrajectory = True
) -> Response:
    """Reads one plan as it was stored. It never changes: `ETag` and `If-None-Match` save a second download."""
    row = find_plan(service, id, whole=trajectory)

    def answer() -> Response:
        return Response(row.document if trajectory else row.summary, media_type="application/json")

    return unchanging(known, f"{row.id}-{'whole' if trajectory else 'summary'}-{fling_version()}", answer)


@router.get(
    "/plans/{id}/trajectory",
    summary="Read a trajectory",
    responses={200: TRAJECTORY_ANSWER, **UNCHANGED, **problem_answers("not-found", "not-acceptable")},
)
def read_trajectory(
    id: PlanId,
    service: ServiceDep,
    caller: AnyCaller,
    known: IfNoneMatch,
    accept: Annotated[str | None, Header(description="application/json or text/csv.")] = None,
) -> Response:
    """Reads the trajectory of a plan, as JSON or CSV."""
    media = preferred_media_type(accept, ("application/json", "text/csv"))
    row = find_plan(service, id)

    def answer() -> Response:
        content = _trajectory_csv(orjson.loads(row.trajectory)) if media == "text/csv" else row.trajectory
        return Response(content, headers={"Vary": "Accept"}, media_type=media)

    return unchanging(known, f"{row.id}-{media.rpartition('/')[2]}-{fling_version()}", answer)


@router.get("/plans/{id}/picture.svg", include_in_schema=False)
def draw_plan(id: PlanId, service: ServiceDep, caller: AnyCaller) -> Response:
    """Draws the motion and the flight of a plan, for the web page."""
    row = find_plan(service, id)
    return Response(plan_svg(orjson.loads(row.document), cell_of_plan(service, row)), media_type="image/svg+xml")


@router.get(
    "/plans/{id}/curves",
    summary="Read a plan's curves",
    responses=json_answer(200, PlanCurves, "At samples of the trajectory.", "not-found", "cell-changed"),
)
def read_plan_curves(id: PlanId, service: ServiceDep, caller: AnyCaller) -> Response:
    """Reads joint motion, torque, speeds, clearances and singularity distances, each with its limits."""
    row = find_plan(service, id)
    document = plan_curves(orjson.loads(row.document), cell_of_plan(service, row))
    return Response(orjson.dumps(document), media_type="application/json")


def find_plan(service: Service, id: str, whole: bool = True) -> PlanRow:
    """Returns a plan by its id or `latest`; without its trajectory unless `whole`.

    Raises:
        ProblemDetails: There is no such plan.
    """
    return find("plan", id, service.store.plan if whole else service.store.plan_summary, service.store.plans)


def cell_of_plan(service: Service, row: PlanRow) -> Cell:
    """Returns the cell that a plan was made for.

    Raises:
        ProblemDetails: Its file has changed since, or is gone.
    """
    try:
        cell = service.cells.cell(row.cell)
    except CellError as error:
        raise ProblemDetails("cell-changed", f"the cell file is refused now: {error}", cell=row.cell) from error
    if cell is None or cell.sha256 != row.cell_sha256:
        change = "is gone" if cell is None else "has changed since planning"
        raise ProblemDetails("cell-changed", f"the cell file {row.cell!r} {change}", cell=row.cell)
    return cell


@dataclass(frozen=True)
class PlanOrder:
    """A request for a plan, with what it came with."""

    body: Mapping[str, Any]
    service: Service
    key: IdempotencyKey | None
    request_id: str
    gone: asyncio.Event
    trajectory: bool
    profile_id: str | None = None  # None: the one that the cell uses
    sent: Mapping[str, Any] | None = None  # what the client sent; None: the body
    nearby: Trajectory | None = None  # a throw from the same start, see `SearchHints`

    def starting(self, start: Mapping[str, Any]) -> PlanOrder:
        """Returns it with another start."""
        return replace(self, body={**self.body, "start": start}, sent=self.body)


async def stored_plan(asked: PlanOrder, observer: Observer | None = None) -> PlanRow:
    """Returns a plan that is stored: that of the request, or of an earlier one with its idempotency key."""
    service = asked.service
    id = None if asked.key is None else await run_in_threadpool(service.store.resource_of_key, asked.key)
    if id is None:
        await run_in_threadpool(service.store.require_room)  # before it is planned
        planned = await _solve(asked, observer)
        id = await run_in_threadpool(_store_plan, service, planned, asked.key)
    row = await run_in_threadpool(service.store.plan if asked.trajectory else service.store.plan_summary, id)
    assert row is not None  # retention deletes no young plan, and keys with their plans
    return row


async def _stored(asked: PlanOrder, observer: Observer | None = None) -> Response:
    """Answers a plan that is stored."""
    row = await stored_plan(asked, observer)
    content = row.document if asked.trajectory else row.summary
    return Response(content, 201, {"Location": f"/plans/{row.id}"}, "application/json")


async def _preview(asked: PlanOrder, observer: Observer | None = None) -> Response:
    """Answers a plan and forgets it: no id, no `Location`, nothing to execute.

    Raises:
        ProblemDetails: The request has an idempotency key, which belongs to something stored.
    """
    if asked.key is not None:
        raise invalid_field("Idempotency-Key", "belongs to a plan that is stored, not to store=false")
    planned = await _solve(asked, observer, is_stored=False)
    content = planned.row.document if asked.trajectory else planned.row.summary
    return Response(content, 200, media_type="application/json")


async def _solve(asked: PlanOrder, observer: Observer | None, is_stored: bool = True) -> PlanRecord:
    """Returns the plan of a request, by a planner process.

    Args:
        asked: the request.
        observer: told of the progress.
        is_stored: whether the plan has an id.
    """
    job = await run_in_threadpool(_planning_job, asked, is_stored)
    job = replace(job, tells_progress=observer is not None)
    service = asked.service
    started_at = time.perf_counter()
    with tracing.traced("plan", fling__cell=job.cell.name, fling__plan_id=job.plan_id) as span:
        try:
            planned = await service.line.solve(job, asked.gone, observer)
        except (PlannerError, PlanningEnded, PlanningQueueFull, PoolBroken) as error:
            name = translate(error).name
            service.metrics.plans.labels(name).inc()
            span.set(fling__problem=name)
            if isinstance(error, InvalidProblem):
                raise InvalidProblem(named_as_sent(asked.sent or asked.body, error.errors)) from error
            raise
        except (ClientGone, asyncio.CancelledError):
            service.metrics.plans.labels("abandoned").inc()
            raise
        finally:
            service.metrics.plan_seconds.observe(time.perf_counter() - started_at)
        _note_attempts(span, planned)
    service.metrics.record_plan(planned.row.summary)
    return planned


def _note_attempts(span: tracing.TracedSpan, planned: PlanRecord) -> None:
    """Adds what the planner tried to the span of a plan."""
    solver = orjson.loads(planned.row.summary)["solver"]
    span.set(fling__backend=planned.row.backend, fling__solve_time_s=solver["solve_time_s"])
    for attempt in solver["attempts"]:
        span.event(attempt["backend"], result=attempt["result"], duration_s=attempt["duration_s"])


def _planning_job(asked: PlanOrder, is_stored: bool) -> PlanningJob:
    """Returns the job for a worker."""
    service = asked.service
    name = asked.body.get("cell") or service.settings.default_cell
    source, _ = service.cells.required(name)
    request = _with_tracked_target(service, {**asked.body, "cell": name})
    start = asked.body.get("start", {})
    nearby = asked.nearby
    if "current" in start:
        request["start"] = {"positions": current_positions(service, name)}
    elif "execution" in start:
        id, motion = _motion_of_execution(service, name, start["execution"], start["at_s"])
        request["start"] = {**motion.state, "execution": id, "at_s": start["at_s"]}
        nearby = motion.throw
    if target_moves(request) and "starts_not_before_s" not in asked.body:
        request["starts_not_before_s"] = controller_time_s(service, name) + START_IN_S
    version = service.note_cell_version(source)
    row = _profile(service, name, source.sha256, asked.profile_id)
    profile = None if row is None else (row.id, row.document)
    plan_id = new_id() if is_stored else None
    return PlanningJob(plan_id, time.time(), source, request, profile, asked.request_id, version, nearby=nearby)


def _profile(service: Service, cell: str, cell_sha256: str, id: str | None) -> ProfileRow | None:
    """Returns the profile that a plan is made with, by default the one that the cell uses; None: the cell file's.

    Raises:
        ProblemDetails: The cell has no such profile for this version of its file.
    """
    if id is None:
        return service.store.profile_in_use(cell, cell_sha256)
    row = service.store.profile(id)
    if row is None or (row.cell, row.cell_sha256) != (cell, cell_sha256):
        raise ProblemDetails("not-found", f"cell {cell!r}, as its file is now, has no profile {id!r}")
    return row


def _with_tracked_target(service: Service, request: dict[str, Any]) -> dict[str, Any]:
    """Returns a request with the numbers of the tracked targets that it names, as last observed.

    Raises:
        ProblemDetails: The cell has no such target.
    """
    known = {path: _as_observed(service, request, path, state) for path, state in tracked_targets(request).items()}
    return with_states(request, known) if known else request


def _as_observed(service: Service, request: Mapping[str, Any], path: str, state: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a state of a request with the numbers of the tracked target that it names."""
    try:
        id = tracked_id(service, request["cell"], state["position"]["target"])
        row = service.store.target(request["cell"], id)
    except UnknownRow as error:
        raise invalid_field(f"{path}.position.target", str(error)) from error
    track = TargetTrack.from_document(row.track)
    cell = service.cell(row.cell)
    x, y, _ = track.position
    place = np.array([x, y, state["position"].get("height_m", _height_m(track, cell))])
    X_RW = np.linalg.inv(cell.X_WB) if request["frame"] == "base" else np.eye(4)
    known = {
        "position": (X_RW[:3, :3] @ place + X_RW[:3, 3]).tolist(),
        "velocity": (X_RW[:3, :3] @ track.velocity).tolist(),
        "observed_at_s": track.observed_at_s,
        "uncertainty": asdict(track.uncertainty),
        "tracked_target": row.id,
    }
    return {**state, **known}


def tracked_id(service: Service, cell: str, id: str) -> str:
    """Returns the id of a target of a cell, given that or `latest`.

    Raises:
        UnknownCell: There is no such cell.
    """
    service.cells.required(cell)
    if id != "latest":
        return id
    return next((row.id for row in service.store.targets_of_cell(cell)), id)


def _height_m(track: TargetTrack, cell: Cell) -> float:
    """Returns the height of a tracked target [m]; one that seems to be within the floor by an error stands on it."""
    floor_m = cell.surroundings.floor_z_m
    height_m = track.position[2]
    return max(height_m, floor_m) if height_m > floor_m - UNCERTAIN_DEVIATIONS * track.height_std_m else height_m


def controller_time_s(service: Service, cell: str) -> float:
    """Returns the time of a cell's controller now [s].

    Raises:
        ProblemDetails: No executor reports it.
    """
    row = service.store.cell_status(cell)
    told_s: Any = row.robot.get("timestamp_s") if row is not None and row.is_alive else None
    if row is None or told_s is None:
        detail = f"no executor reports the controller's time of cell {cell!r}: give starts_not_before_s"
        raise ProblemDetails("robot-not-ready", detail, cell=cell)
    return float(told_s) + max(time.time() - row.heartbeat_at, 0.0)


def current_positions(service: Service, cell: str) -> list[float]:
    """Returns the joint positions of a cell's robot as its executor reports them (6,) [rad].

    Raises:
        ProblemDetails: Nobody reports them.
    """
    row = service.store.cell_status(cell)
    positions: Any = row.robot.get("positions") if row is not None and row.is_alive else None
    if positions is None:
        detail = f"no executor reports the joint positions of cell {cell!r}"
        raise ProblemDetails("robot-not-ready", detail, cell=cell)
    return [float(q) for q in positions]


def _motion_of_execution(service: Service, cell: str, id: str, at_s: float) -> tuple[str, RunningMotion]:
    """Returns the id of an execution, and its motion from the tick nearest to a time [s] on.

    Raises:
        ProblemDetails: There is no such execution, it has ended or is another cell's, or its motion ends before.
    """
    row = find("execution", id, service.store.execution, service.store.executions)
    if row.state == "finished" or row.cell != cell:
        what = "has ended" if row.state == "finished" else f"is of cell {row.cell!r}"
        raise invalid_field("start.execution", f"{row.id} {what}: no motion can begin on it")
    motion = running_motion(service, row, at_s)
    if motion is None:
        raise invalid_field("start.at_s", f"{at_s:g} s is after the end of the motion")
    return row.id, motion


def _store_plan(service: Service, planned: PlanRecord, key: IdempotencyKey | None) -> str:
    """Stores the plan and returns its id; the first one's id if the same request arrived twice at once."""
    try:
        service.store.add_plan(planned.row, key)
    except KeyTaken as taken:
        return taken.resource_of(key)
    return planned.row.id


def _trajectory_csv(trajectory: dict[str, Any]) -> str:
    """Returns one row per tick: time, then positions, velocities and accelerations of every joint."""
    kinds = {"positions": "position_rad", "velocities": "velocity_rad_s", "accelerations": "acceleration_rad_s2"}
    names = trajectory["joint_names"]
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["time_from_start_s", *(f"{name}_{suffix}" for suffix in kinds.values() for name in names)])
    columns = [trajectory["time_from_start"], *(trajectory[kind] for kind in kinds)]
    for t, q, qd, qdd in zip(*columns, strict=True):
        rows.writerow([t, *q, *qd, *qdd])
    return text.getvalue()
