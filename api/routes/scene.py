"""What a picture needs: the model of a cell, the curves of a plan."""

from __future__ import annotations

import orjson
from fastapi import APIRouter, Response

from api.dependencies import AnyCaller, ServiceDep
from api.http import json_answer
from api.routes.cells import CellName
from api.routes.plans import PlanId, cell_of_plan, find_plan
from api.scene import cell_model, plan_curves
from api.schemas import CellModel, PlanCurves

router = APIRouter()


@router.get(
    "/cells/{name}/model",
    tags=["cells"],
    summary="Read a cell's model",
    responses=json_answer(200, CellModel, "As the planner sees the cell.", "not-found", "invalid-request"),
)
def read_cell_model(name: CellName, service: ServiceDep, caller: AnyCaller) -> Response:
    """Reads the kinematic chain, capsules, limits and surroundings that plans are made with: enough to draw them."""
    return Response(orjson.dumps(cell_model(service.cell(name))), media_type="application/json")


@router.get(
    "/plans/{id}/curves",
    tags=["plans"],
    summary="Read a plan's curves",
    responses=json_answer(200, PlanCurves, "At samples of the trajectory.", "not-found", "cell-changed"),
)
def read_plan_curves(id: PlanId, service: ServiceDep, caller: AnyCaller) -> Response:
    """Reads joint motion, torque, speeds, clearances and singularity distances, each with its limits."""
    row = find_plan(service, id)
    document = plan_curves(orjson.loads(row.document), cell_of_plan(service, row))
    return Response(orjson.dumps(document), media_type="application/json")
