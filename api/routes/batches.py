"""Batches: many planning requests at once; create, list, watch, read the results, cancel."""

from __future__ import annotations

import os
import tempfile
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Body, Header, Query, Request, Response
from fastapi.responses import FileResponse, JSONResponse, StreamingResponse
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool

from api.batch_requests import batch_document, batch_specification
from api.dependencies import PLAIN, AnyCaller, Key, Origin, PlanCaller, Service, ServiceDep, find, id_in_path, make_once
from api.http import (
    StrictJsonRoute,
    event_stream,
    event_stream_answer,
    invalid_field,
    json_answer,
    preferred_media_type,
    problem_answers,
)
from api.progress_feed import ProgressSeen, progress_events
from api.routes.plans import POST_PROBLEMS, PageCursor, PageLimit
from api.schemas import BATCH_EXAMPLES, BatchAnswer, BatchList, BatchRequest, BatchResultList
from jobs.batches import PARQUET, BatchRequests, BatchSpecification, Parameters, ParquetMissing, write_table
from store import BatchResultRow, BatchRow, Store

router = APIRouter(route_class=StrictJsonRoute, tags=["batches"])

SIZE_MAX = 100_000  # requests of one batch: some seconds to check
BatchId = Annotated[str, id_in_path("batch")]
BatchBody = Annotated[BatchRequest, Body(openapi_examples=BATCH_EXAMPLES)]  # type: ignore[arg-type]
GRIDS_KEPT = 16  # so that not every page of results reads its batch again
ResultCursor = Annotated[int, Query(ge=-1, le=2**31 - 1, description="`next_cursor` of the page before."), PLAIN]
TABLES = {"text/csv": ".csv", PARQUET: ".parquet"}
RESULTS_ANSWER = {
    "model": BatchResultList,
    "content": {
        "text/csv": {"schema": {"type": "string"}},
        PARQUET: {"schema": {"type": "string", "format": "binary"}},
    },
    "description": "A page in JSON; or all results so far as CSV or Parquet, by `Accept`.",
}
EVENTS_ANSWER = event_stream_answer("Its progress whenever it changes; ends with the batch.", progress=BatchAnswer)


@router.post(
    "/batches",
    status_code=201,
    summary="Plan many throws",
    responses=json_answer(201, BatchAnswer, "Checked and queued.", *POST_PROBLEMS),
)
async def make_batch(
    body: BatchBody, request: Request, service: ServiceDep, caller: PlanCaller, key: Key, origin: Origin
) -> Response:
    """Queues many planning requests; each is checked before. Their plans are stored like any other plan.

    Requests that ask for the same are planned once. A batch survives the end of the service: it resumes when the
    service starts again.
    """

    store = service.store

    def queue() -> str:
        store.require_room()
        asked = batch_specification(body, store, service.cells, service.settings.default_cell, SIZE_MAX)
        act = origin.act(caller, "batch")
        return store.add_batch(asked.pack(), len(asked.requests), caller.name, "service", key, act).id

    id = await to_thread.run_sync(make_once, store, key, queue, limiter=request.app.state.lanes.large)
    row = await run_in_threadpool(find_batch, service, id)
    service.batch_drivers.wake()
    return JSONResponse(batch_document(row), 201, {"Location": f"/batches/{row.id}"})


@router.get("/batches", summary="List batches", responses=json_answer(200, BatchList, "Newest first."))
def list_batches(
    service: ServiceDep, caller: AnyCaller, limit: PageLimit = 50, cursor: PageCursor = None
) -> JSONResponse:
    """Lists batches with their progress, newest first."""
    rows, following = service.store.batches(limit, cursor)
    return JSONResponse({"batches": [batch_document(row) for row in rows], "next_cursor": following})


@router.get(
    "/batches/{id}", summary="Read a batch", responses=json_answer(200, BatchAnswer, "Its progress.", "not-found")
)
def read_batch(id: BatchId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads the progress of a batch: results by outcome, rate, time left."""
    return JSONResponse(batch_document(find_batch(service, id)))


@router.post(
    "/batches/{id}/cancel",
    status_code=202,
    summary="Cancel a batch",
    responses=json_answer(202, BatchAnswer, "Its driver stops soon; what is planned stays.", "not-found", "forbidden"),
)
def cancel_batch(id: BatchId, service: ServiceDep, caller: PlanCaller, origin: Origin) -> JSONResponse:
    """Ends a batch before all is planned. Its results so far stay; repeated, it changes nothing."""
    row = service.store.cancel_batch(find_batch(service, id).id, origin.act(caller, "cancel-batch"))
    return JSONResponse(batch_document(row), 202)


@router.get(
    "/batches/{id}/events",
    summary="Watch a batch",
    response_class=StreamingResponse,
    responses={200: EVENTS_ANSWER, **problem_answers("not-found", "invalid-request")},
)
async def watch_batch(
    id: BatchId,
    request: Request,
    service: ServiceDep,
    caller: AnyCaller,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Skips progress that the client has."), PLAIN] = 0,
) -> StreamingResponse:
    """Streams the progress of a batch as server-sent events until it is finished."""
    row = await run_in_threadpool(find_batch, service, id)
    look = partial(_progress, service.store, row.id)
    return event_stream(progress_events(request, look, last_event_id), request.state.is_allowed)


@router.get(
    "/batches/{id}/results",
    summary="Read the results of a batch",
    responses={200: RESULTS_ANSWER, **problem_answers("not-found", "not-acceptable", "invalid-request")},
)
def read_batch_results(
    id: BatchId,
    service: ServiceDep,
    caller: AnyCaller,
    limit: PageLimit = 50,
    cursor: ResultCursor = -1,
    accept: Annotated[str | None, Header(description=f"application/json, text/csv or {PARQUET}.")] = None,
) -> Response:
    """Reads results in the order of their requests: a page in JSON, or all of them as CSV or Parquet."""
    media = preferred_media_type(accept, ("application/json", *TABLES))
    row = find_batch(service, id)
    if media in TABLES:
        return _table(service.store, row.id, media)
    results, following = service.store.batch_results(row.id, limit, cursor)
    grid = _grid(service.store, row.id)
    documents = [_result(result, _parameters(grid, result.number)) for result in results]
    return JSONResponse({"results": documents, "next_cursor": following}, headers={"Vary": "Accept"})


def find_batch(service: Service, id: str) -> BatchRow:
    """Returns a batch by its id or `latest`.

    Raises:
        ProblemDetails: There is no such batch.
    """
    return find("batch", id, service.store.batch, service.store.batches)


def _progress(store: Store, id: str) -> ProgressSeen | None:
    row = store.batch(id)
    if row is None:
        return None
    is_over = row.state == "finished"
    return ProgressSeen(row.done + 1 + (row.total + 1 if is_over else 0), batch_document(row), is_over)


@lru_cache(GRIDS_KEPT)
def _grid(store: Store, id: str) -> BatchRequests | None:
    """Returns the grid of a batch, which never changes; None for a list, which may have a million requests."""
    requests = BatchSpecification.stored(store, id).requests
    return requests if requests.requests is None else None


def _parameters(grid: BatchRequests | None, number: int) -> Parameters:
    return {} if grid is None else grid.parameters(number)


def _result(row: BatchResultRow, parameters: Parameters) -> dict[str, Any]:
    document = {**vars(row), "parameters": parameters}
    del document["batch_id"]
    return document


def _table(store: Store, id: str, media: str) -> FileResponse:
    """Returns all results as a file, which is written first: a million rows never stay in memory.

    Raises:
        ProblemDetails: The library for Parquet is not installed.
    """
    handle, name = tempfile.mkstemp(suffix=TABLES[media], prefix="fling-batch-")
    os.close(handle)
    path = Path(name)
    grid = _grid(store, id)
    try:
        write_table(path, ((row, _parameters(grid, row.number)) for row in store.all_batch_results(id)))
    except ParquetMissing as error:
        path.unlink()
        raise invalid_field("accept", f"{media} {error}") from None
    file_name = f"batch-{id}{TABLES[media]}"
    clean_up = BackgroundTask(path.unlink)
    return FileResponse(path, media_type=media, filename=file_name, headers={"Vary": "Accept"}, background=clean_up)
