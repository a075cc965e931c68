"""Experiments: series of executions; create, list, read with statistics, as CSV, as a picture."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, Response
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, Key, OperateCaller, Origin, Service, ServiceDep, find, id_in_path, make_once
from api.experiment_statistics import statistics_by_target, statistics_of, throws_of
from api.http import (
    StrictJsonRoute,
    invalid_field,
    json_answer,
    preferred_media_type,
    problem_answers,
)
from api.report import landings_svg
from api.routes.plans import POST_PROBLEMS, PageCursor, PageLimit
from api.schemas import (
    EXPERIMENT_EXAMPLES,
    ExperimentAnswer,
    ExperimentHead,
    ExperimentList,
    ExperimentRequest,
    iso_time,
)
from jobs.batches import NUMBER, PARQUET, TEXT, TEXTS, ParquetMissing, write_csv, write_parquet
from store import ExperimentRow

router = APIRouter(route_class=StrictJsonRoute, tags=["experiments"])

ExperimentId = Annotated[str, id_in_path("experiment")]
ExperimentBody = Annotated[ExperimentRequest, Body(openapi_examples=EXPERIMENT_EXAMPLES)]  # type: ignore[arg-type]
AXES = ("x", "y", "z")
COLUMNS = {
    **dict.fromkeys(("execution_id", "plan_id", "state", "outcome"), TEXT),
    **dict.fromkeys((f"{point}_{axis}_m" for point in ("target", "landing") for axis in AXES), NUMBER),
    "error_m": NUMBER,
    "results": TEXTS,
}
ANSWER = {
    "model": ExperimentAnswer,
    "content": {
        "text/csv": {"schema": {"type": "string"}},
        PARQUET: {"schema": {"type": "string", "format": "binary"}},
    },
    "description": "JSON with statistics, or CSV or Parquet with one row per throw, by `Accept`.",
}


@router.post(
    "/experiments",
    status_code=201,
    summary="Begin an experiment",
    responses=json_answer(201, ExperimentHead, "Executions that name it belong to it.", *POST_PROBLEMS),
)
def begin_experiment(
    body: ExperimentBody, service: ServiceDep, caller: OperateCaller, key: Key, origin: Origin
) -> JSONResponse:
    """Begins a series of throws. Executions join it by `experiment_id`; it moves nothing by itself."""

    def begin() -> str:
        service.store.require_room()
        act = origin.act(caller, "experiment")
        return service.store.add_experiment(body.name, caller.name, body.settings, key, act).id

    row = find_experiment(service, make_once(service.store, key, begin))
    return JSONResponse(_head(row), 201, {"Location": f"/experiments/{row.id}"})


@router.get("/experiments", summary="List experiments", responses=json_answer(200, ExperimentList, "Newest first."))
def list_experiments(
    service: ServiceDep, caller: AnyCaller, limit: PageLimit = 50, cursor: PageCursor = None
) -> JSONResponse:
    """Lists experiments, newest first, without their throws."""
    rows, following = service.store.experiments(limit, cursor)
    return JSONResponse({"experiments": [_head(row) for row in rows], "next_cursor": following})


@router.get(
    "/experiments/{id}",
    summary="Read an experiment",
    responses={200: ANSWER, **problem_answers("not-found", "not-acceptable", "invalid-request")},
)
def read_experiment(
    id: ExperimentId,
    service: ServiceDep,
    caller: AnyCaller,
    accept: Annotated[
        str | None, Header(description="application/json, text/csv or application/vnd.apache.parquet.")
    ] = None,
) -> Response:
    """Reads the state of each throw, and mean and spread of the landings so far."""
    media = preferred_media_type(accept, ("application/json", "text/csv", PARQUET))
    row = find_experiment(service, id)
    throws = _throws(service, row)
    headers = {"Vary": "Accept"}
    if media != "application/json":
        return Response(_table(throws, media), headers=headers, media_type=media)
    document = {"throws": throws, "statistics": statistics_of(throws), "targets": statistics_by_target(throws)}
    return JSONResponse({**_head(row), **document}, headers=headers)


@router.get("/experiments/{id}/picture.svg", include_in_schema=False)
def draw_experiment(id: ExperimentId, service: ServiceDep, caller: AnyCaller) -> Response:
    """Draws the landings about their targets."""
    throws = _throws(service, find_experiment(service, id))
    return Response(landings_svg(throws), media_type="image/svg+xml")


def find_experiment(service: Service, id: str) -> ExperimentRow:
    """Returns an experiment by its id or `latest`.

    Raises:
        ProblemDetails: There is no such experiment.
    """
    return find("experiment", id, service.store.experiment, service.store.experiments)


def _throws(service: Service, row: ExperimentRow) -> list[dict[str, Any]]:
    store = service.store
    executions = store.executions_of_experiment(row.id)
    landings = store.landings_of_experiment(row.id)
    return throws_of(executions, landings, store.plans_of_experiment(row.id))


def _head(row: ExperimentRow) -> dict[str, Any]:
    return {**vars(row), "created_at": iso_time(row.created_at)}


def _table(throws: Sequence[dict[str, Any]], media: str) -> bytes:
    """Returns a row a throw.

    Raises:
        ProblemDetails: The library for Parquet is not installed.
    """
    stream = io.BytesIO()
    rows = [
        {**throw, **_coordinates("target", throw["target"]), **_coordinates("landing", throw["landing"])}
        for throw in throws
    ]
    try:
        (write_parquet if media == PARQUET else write_csv)(COLUMNS, rows, stream)
    except ParquetMissing as error:
        raise invalid_field("accept", f"{media} {error}") from None
    return stream.getvalue()


def _coordinates(point: str, position: Sequence[float] | None) -> dict[str, float | None]:
    return {f"{point}_{axis}_m": None if position is None else position[i] for i, axis in enumerate(AXES)}
