"""Jobs: picks and throws one after another; order, watch, pause, cancel, read what became of every object."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any

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
    ProblemDetails,
    StrictJsonRoute,
    event_stream,
    event_stream_answer,
    invalid_field,
    json_answer,
    preferred_media_type,
    problem_answers,
)
from api.job_requests import check_order, job_document, job_head, result_documents
from api.progress_feed import ProgressSeen, progress_events
from api.routes.executions import UNGUARDED
from api.routes.plans import POST_PROBLEMS, PageCursor, PageLimit
from api.schemas import JOB_EXAMPLES, JobAnswer, JobHead, JobList, JobRequestBody, ObjectResultList
from jobs.batches import INTEGER, NUMBER, PARQUET, TEXT, ParquetMissing, write_csv, write_parquet
from jobs.cycles import JobOrder
from store import JobRow, Store

router = APIRouter(route_class=StrictJsonRoute, tags=["jobs"])

JobId = Annotated[str, id_in_path("job")]
JobBody = Annotated[JobRequestBody, Body(openapi_examples=JOB_EXAMPLES)]  # type: ignore[arg-type]
PickCursor = Annotated[int, Query(ge=-1, le=2**31 - 1, description="`next_cursor` of the page before."), PLAIN]
COLUMNS = {
    "pick": INTEGER,
    **dict.fromkeys(("object", "result", "object_at", "reason"), TEXT),
    **dict.fromkeys(("attempts", "target", "turn"), INTEGER),
    **dict.fromkeys(("outcome", "plan_id", "execution_id"), TEXT),
    **dict.fromkeys(("landing_x_m", "landing_y_m", "landing_z_m", "error_m"), NUMBER),
    **dict.fromkeys(("asked_at", "ended_at"), TEXT),
}
RESULTS_ANSWER = {
    "model": ObjectResultList,
    "content": {
        "text/csv": {"schema": {"type": "string"}},
        PARQUET: {"schema": {"type": "string", "format": "binary"}},
    },
    "description": "A page in JSON; or all objects as CSV or Parquet, by `Accept`.",
}
EVENTS_ANSWER = event_stream_answer("Its progress whenever it changes; ends with the job.", progress=JobAnswer)


@router.post(
    "/jobs",
    status_code=201,
    summary="Pick and throw",
    responses={
        **json_answer(201, JobAnswer, "Checked and queued.", *POST_PROBLEMS),
        **problem_answers("not-found"),
    },
)
def make_job(body: JobBody, service: ServiceDep, caller: OperateCaller, key: Key, origin: Origin) -> Response:
    """Queues picks and throws of a cell, one after another. **This moves the robot**, as soon as its cell is free.

    A cycle is one plan: at rest at a pick, line up, throw, line down, at rest at the next pick. The next cycle is
    planned while the arm moves. A job survives the end of the service; jobs of a cell are done in their order.
    """

    def queue() -> str:
        service.store.require_room()
        order = JobOrder.read(body, service.settings.default_cell)
        _, cell = service.cells.required(order.cell)
        if cell.link.kind != "sim" and not service.tokens.is_guarded:
            raise ProblemDetails("forbidden", UNGUARDED)
        check_order(order, cell)
        act = origin.act(caller, "job")
        return service.store.add_job(order.cell, order.to_json(), len(order.picks), caller.name, key, act).id

    row = find_job(service, make_once(service.store, key, queue))
    return JSONResponse(_document(service.store, row), 201, {"Location": f"/jobs/{row.id}"})


@router.get("/jobs", summary="List jobs", responses=json_answer(200, JobList, "Newest first."))
def list_jobs(service: ServiceDep, caller: AnyCaller, limit: PageLimit = 50, cursor: PageCursor = None) -> JSONResponse:
    """Lists jobs without their records, newest first."""
    rows, following = service.store.jobs(limit, cursor)
    return JSONResponse({"jobs": [job_head(row) for row in rows], "next_cursor": following})


@router.get("/jobs/{id}", summary="Read a job", responses=json_answer(200, JobAnswer, "Its record.", "not-found"))
def read_job(id: JobId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads how far a job is: what runs, cycles an hour, hits with their interval, misses by cause."""
    return JSONResponse(_document(service.store, find_job(service, id)))


@router.post(
    "/jobs/{id}/pause",
    status_code=202,
    summary="Pause a job",
    responses=json_answer(202, JobHead, "It pauses once the motion that runs has ended.", "not-found", "forbidden"),
)
def pause_job(id: JobId, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Pauses a job after the motion that runs, with the arm at rest at the next pick. Repeated, it changes nothing."""
    row = service.store.pause_job(find_job(service, id).id, origin.act(caller, "pause-job"))
    return JSONResponse(job_head(row), 202)


@router.post(
    "/jobs/{id}/resume",
    status_code=202,
    summary="Resume a job",
    responses=json_answer(202, JobHead, "It goes on, if it was paused or had stopped.", "not-found", "forbidden"),
)
def resume_job(id: JobId, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Goes on with a job that is paused, or that has stopped. **This moves the robot.**

    What was put aside stays so; an object that was certainly not thrown, and lies at its pick, is picked again.
    """
    row = service.store.resume_job(find_job(service, id).id, origin.act(caller, "resume-job"))
    return JSONResponse(job_head(row), 202)


@router.post(
    "/jobs/{id}/cancel",
    status_code=202,
    summary="Cancel a job",
    responses=json_answer(202, JobHead, "It ends once the motion that runs has ended.", "not-found", "forbidden"),
)
def cancel_job(id: JobId, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Ends a job after the motion that runs; abort its execution to brake now. Repeated, it changes nothing."""
    row = service.store.cancel_job(find_job(service, id).id, origin.act(caller, "cancel-job"))
    return JSONResponse(job_head(row), 202)


@router.get(
    "/jobs/{id}/events",
    summary="Watch a job",
    response_class=StreamingResponse,
    responses={200: EVENTS_ANSWER, **problem_answers("not-found", "invalid-request")},
)
async def watch_job(
    id: JobId,
    request: Request,
    service: ServiceDep,
    caller: AnyCaller,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Skips progress that the client has."), PLAIN] = 0,
) -> StreamingResponse:
    """Streams the progress of a job as server-sent events until it is finished."""
    row = await run_in_threadpool(find_job, service, id)
    look = partial(_progress, service.store, row.id)
    return event_stream(progress_events(request, look, last_event_id), request.state.is_allowed)


@router.get(
    "/jobs/{id}/results",
    summary="Read what became of every object",
    responses={200: RESULTS_ANSWER, **problem_answers("not-found", "not-acceptable", "invalid-request")},
)
def read_job_results(
    id: JobId,
    service: ServiceDep,
    caller: AnyCaller,
    limit: PageLimit = 50,
    cursor: PickCursor = -1,
    accept: Annotated[str | None, Header(description=f"application/json, text/csv or {PARQUET}.")] = None,
) -> Response:
    """Reads what became of every object, in the order of the picks: a page in JSON, or all as CSV or Parquet."""
    media = preferred_media_type(accept, ("application/json", "text/csv", PARQUET))
    row = find_job(service, id)
    results = result_documents(row, service.store.job_cycles(row.id), service.store.landings_of_job(row.id))
    headers = {"Vary": "Accept"}
    if media != "application/json":
        return Response(_table(results, media), headers=headers, media_type=media)
    page = results[cursor + 1 : cursor + 1 + limit]
    following = cursor + limit if cursor + 1 + limit < len(results) else None
    return JSONResponse({"results": page, "next_cursor": following}, headers=headers)


def find_job(service: Service, id: str) -> JobRow:
    """Returns a job by its id or `latest`.

    Raises:
        ProblemDetails: There is no such job.
    """
    return find("job", id, service.store.job, service.store.jobs)


def _progress(store: Store, id: str) -> ProgressSeen | None:
    row = store.job(id)
    return None if row is None else ProgressSeen(row.revision, _document(store, row), row.state == "finished")


def _document(store: Store, row: JobRow) -> dict[str, Any]:
    return job_document(row, store.job_cycles(row.id), store.landings_of_job(row.id))


def _table(results: Sequence[dict[str, Any]], media: str) -> bytes:
    """Returns a row an object.

    Raises:
        ProblemDetails: The library for Parquet is not installed.
    """
    stream = io.BytesIO()
    try:
        (write_parquet if media == PARQUET else write_csv)(COLUMNS, results, stream)
    except ParquetMissing as error:
        raise invalid_field("accept", f"{media} {error}") from None
    return stream.getvalue()
