"""Cells: the files, the executors that serve them, the live state of their robots."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path
from fastapi.responses import JSONResponse

from api.deps import ClientDep, OperatorClient, Remote, Service, ServiceDep
from api.documented import json_answer, problems_of
from api.errors import Problem
from api.presence import executor_document, is_alive
from api.schemas.executions import Acknowledged, CellList, CellState
from planner.errors import CellError
from store import CellRow

router = APIRouter(tags=["cells"])

CellName = Annotated[str, Path(description="Name of a cell.", max_length=64, openapi_examples={
    "default": {"summary": "the default cell", "value": "ur5e-sim"}})]  # fmt: skip


@router.get("/cells", summary="List cells", responses=json_answer(200, CellList, "Every cell file."))
def list_cells(service: ServiceDep, client: ClientDep) -> JSONResponse:
    """Lists the cell files, the refused ones with the reason, and who serves each cell."""
    rows = {row.cell: row for row in service.store.cell_statuses()}
    return JSONResponse({"cells": [_summary(service, name, rows.get(name)) for name in service.shelf.names()]})


@router.get("/cells/{name}", summary="Read a cell", responses={
    200: {"description": "The keys and numbers of the cell file, defaults filled in, and `name` and `sha256`; units in "
          "the names.", "content": {"application/json": {"schema": {"type": "object"}}}},
    **problems_of("not-found", "invalid-request")})  # fmt: skip
def read_cell(name: CellName, service: ServiceDep, client: ClientDep) -> JSONResponse:
    """Reads a cell file as JSON, with every default filled in."""
    return JSONResponse(service.cell(name).as_document())


@router.get(
    "/cells/{name}/state", summary="Look at a robot",
    responses={**json_answer(200, CellState, "As its executor last told."), **problems_of("not-found")},
)  # fmt: skip
def read_state(name: CellName, service: ServiceDep, client: ClientDep) -> JSONResponse:
    """Reads the live state of a cell's robot: mode, safety, joint positions; and a latched fault."""
    service.cell(name)
    row = service.store.cell_status(name)
    document = {"cell": name, "executor": executor_document(row), "execution_id": service.store.open_execution(name)}
    robot = dict(row.robot) if row is not None and is_alive(row) else None
    fault = None if row is None or row.fault is None else dict(row.fault)
    return JSONResponse({**document, "robot": robot, "fault": fault})


@router.post(
    "/cells/{name}/acknowledge", summary="Acknowledge a fault",
    responses={**json_answer(200, Acknowledged, "The executor clears its latched fault."),
               **problems_of("not-found", "robot-not-ready", "unauthenticated", "forbidden")},
)  # fmt: skip
def acknowledge(name: CellName, service: ServiceDep, client: OperatorClient, remote: Remote) -> JSONResponse:
    """A person has looked at the robot: clear the fault that its executor latched."""
    service.cell(name)
    row = service.store.cell_status(name)
    if row is None or not is_alive(row):
        raise Problem("robot-not-ready", f"cell {name!r} has no executor that could clear a fault", cell=name)
    service.store.request_acknowledge(name, client.name)
    service.store.add_audit(client.name, "acknowledge", f"/cells/{name}", remote)
    fault = None if row.fault is None else dict(row.fault)
    return JSONResponse({"cell": name, "acknowledged_by": client.name, "fault": fault})


def _summary(service: Service, name: str, row: CellRow | None) -> dict[str, Any]:
    document: dict[str, Any] = {"name": name, "robot": None, "link_kind": None, "sha256": None, "error": None}
    document |= {"default": name == service.settings.default_cell, "executor": executor_document(row)}
    try:
        cell = service.cell(name)
    except CellError as error:
        return {**document, "error": str(error)}
    return {**document, "robot": cell.robot.name, "link_kind": cell.link.kind, "sha256": cell.sha256}
