"""Cells: their files and versions, their executors, the live state of their robots, the timing of their arms."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse

from api.cell_history import history_document
from api.dependencies import AnyCaller, OperateCaller, Origin, Service, ServiceDep, name_in_path
from api.http import ProblemDetails, json_answer, problem_answers
from api.routes.executions import reason_not_executable
from api.scene import cell_model
from api.schemas import Acknowledged, CellHistory, CellList, CellModel, CellState, TimingAnswer, iso_time
from learning import cell_in_use, pooled_document, timing_runs
from planner.errors import CellError
from store import CellRow

router = APIRouter(tags=["cells"])

CellName = Annotated[str, name_in_path("Name of a cell.", "default", "ur5e-sim", "the default cell")]
CELL_FILE_ANSWER = {
    "description": "The keys and numbers of the cell file with defaults filled in, and `name` and `sha256`; units are "
    "part of the names.",
    "content": {"application/json": {"schema": {"type": "object"}}},
}


@router.get("/cells", summary="List cells", responses=json_answer(200, CellList, "Every cell file."))
def list_cells(service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists the cell files and their executors; refused files come with the reason."""
    rows = {row.cell: row for row in service.store.cell_statuses()}
    return JSONResponse({"cells": [_summary(service, name, rows.get(name)) for name in service.cells.names()]})


@router.get(
    "/cells/{name}",
    summary="Read a cell",
    responses={200: CELL_FILE_ANSWER, **problem_answers("not-found", "invalid-request")},
)
def read_cell(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads a cell file as JSON, with every default filled in."""
    return JSONResponse(service.cell(name).as_document())


@router.get(
    "/cells/{name}/state",
    summary="Read a robot's state",
    responses=json_answer(200, CellState, "As its executor last reported.", "not-found"),
)
def read_robot_state(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads the live state of a cell's robot: mode, safety, joint positions; and a latched fault."""
    cell = service.cell(name)
    row = service.store.cell_status(name)
    document = {"cell": name, "executor": _executor(row), "execution_id": service.store.open_execution(name)}
    document["not_executable"] = reason_not_executable(service, caller, cell, row)
    document["robot_request"] = robot_request_document(row)
    robot, fault = (row.robot if row.is_alive else None, row.fault) if row is not None else (None, None)
    return JSONResponse({**document, "robot": robot, "fault": fault})


@router.post(
    "/cells/{name}/acknowledge",
    summary="Acknowledge a fault",
    responses={
        **json_answer(200, Acknowledged, "The executor clears its latched fault.", "not-found"),
        **problem_answers("robot-not-ready", "unauthenticated", "forbidden"),
    },
)
def acknowledge_fault(name: CellName, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Clears the fault that the executor latched, once a person has checked the robot."""
    service.cell(name)
    row = service.store.cell_status(name)
    if row is None or not row.is_alive:
        raise ProblemDetails("robot-not-ready", f"cell {name!r} has no executor that could clear a fault", cell=name)
    service.store.request_acknowledge(name, caller.name, origin.act(caller, "acknowledge"))
    return JSONResponse({"cell": name, "acknowledged_by": caller.name, "fault": row.fault})


@router.get(
    "/cells/{name}/history",
    summary="List the versions of a cell",
    responses=json_answer(200, CellHistory, "Newest first, with what changed.", "not-found", "invalid-request"),
)
def read_history(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists the versions of a cell file that service or executor have seen, each with the keys that it changed."""
    with suppress(CellError):  # a file that is refused has a history all the same
        service.cell(name)
        service.cell_version(name)
    return JSONResponse(history_document(name, service.store.cell_versions(name)))


@router.get(
    "/cells/{name}/model",
    summary="Read a cell's model",
    responses=json_answer(200, CellModel, "As the planner sees the cell.", "not-found", "invalid-request"),
)
def read_cell_model(name: CellName, service: ServiceDep, caller: AnyCaller) -> Response:
    """Reads the kinematic chain, capsules, limits and surroundings that plans are made with: enough to draw them."""
    return Response(orjson.dumps(cell_model(service.cell(name))), media_type="application/json")


@router.get(
    "/cells/{name}/timing",
    summary="Read the arm's timing",
    responses=json_answer(200, TimingAnswer, "Newest run first.", "not-found", "invalid-request"),
)
def read_timing(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads lag, gain, first-order part and overshoot of every joint, run by run and pooled, with standard errors.

    Runs under other versions of the cell file count, unless that version describes another arm.
    """
    cell = service.cell(name)
    found = timing_runs(service.store, cell)
    runs = [{"execution_id": row.id, "finished_at": iso_time(row.finished_at), **timing} for row, timing in found]
    assumed_s = cell_in_use(service.store, cell)[0].timing.lag_s
    pooled = pooled_document([timing for _, timing in found], assumed_s)
    return JSONResponse({"cell": name, "assumed_lag_s": assumed_s, "pooled": pooled, "runs": runs})


def robot_request_document(row: CellRow | None) -> dict[str, Any] | None:
    """Returns the newest request to operate a cell's robot as JSON; None without one."""
    request = None if row is None else row.robot_request
    if row is None or request is None:
        return None
    document = {**request, "requested_at": iso_time(request["requested_at"])}
    answer = row.robot_answer
    if answer is None or row.open_robot_request is not None:
        return {**document, "state": "waiting", "text": ""}
    return {**document, "state": "done" if answer["done"] else "refused", "text": answer["text"]}


def _summary(service: Service, name: str, row: CellRow | None) -> dict[str, Any]:
    document: dict[str, Any] = {"name": name, "robot": None, "link_kind": None, "sha256": None, "error": None}
    document["link_host"] = None
    document |= {"default": name == service.settings.default_cell, "executor": _executor(row)}
    try:
        cell = service.cell(name)
    except CellError as error:
        return {**document, "error": str(error)}
    link = {"link_kind": cell.link.kind, "link_host": cell.link.host}
    return {**document, "robot": cell.robot.name, **link, "sha256": cell.sha256}


def _executor(row: CellRow | None) -> dict[str, Any] | None:
    """Returns the executor of a cell as JSON; None if it never had one."""
    if row is None:
        return None
    age = max(0.0, time.time() - row.heartbeat_at)
    return {"id": row.executor_id, "alive": row.is_alive, "heartbeat_age_s": age, "read_only": row.read_only}
