"""Operating a robot: power, brakes, protective stops, by whichever interface its controller has."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body
from fastapi.responses import JSONResponse

from api.dependencies import OperateCaller, Origin, ServiceDep
from api.http import ProblemDetails, StrictJsonRoute, json_answer, problem_answers
from api.routes.cells import CellName, robot_request_document
from api.routes.executions import UNGUARDED
from api.schemas import ROBOT_EXAMPLES, RobotActionAnswer, RobotActionRequest

router = APIRouter(route_class=StrictJsonRoute, tags=["cells"])

RobotBody = Annotated[RobotActionRequest, Body(openapi_examples=ROBOT_EXAMPLES)]  # type: ignore[arg-type]


@router.post(
    "/cells/{name}/robot",
    status_code=202,
    summary="Operate a robot",
    responses={
        **json_answer(202, RobotActionAnswer, "Asked of the executor.", "not-found", "invalid-request"),
        **problem_answers("robot-busy", "robot-not-ready", "unauthenticated", "forbidden"),
    },
)
def operate_robot(
    name: CellName, body: RobotBody, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Powers an arm on or off, releases its brakes, or unlocks a protective stop: once somebody has looked at it.

    The executor does it between executions; `robot_request` of `GET /cells/{name}/state` tells what became of it.
    **Brakes that are released let the arm sink a little.**
    """
    cell = service.cell(name)
    if cell.link.kind != "sim" and not service.tokens.is_guarded:
        raise ProblemDetails("forbidden", UNGUARDED)
    row = service.store.cell_status(name)
    if row is None or not row.is_alive:
        raise ProblemDetails("robot-not-ready", f"cell {name!r} has no executor that could do it", cell=name)
    if row.read_only:
        raise ProblemDetails("robot-not-ready", f"the executor of cell {name!r} is read-only", cell=name)
    if service.store.open_execution(name) is not None:
        raise ProblemDetails("robot-busy", f"cell {name!r} has an unfinished execution", cell=name)
    service.store.request_robot_action(name, body.action, caller.name, origin.act(caller, f"robot {body.action}"))
    return JSONResponse(robot_request_document(service.store.cell_status(name)), 202)
