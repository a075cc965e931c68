"""A new target for a running motion, in one call: planned from the earliest tick that can be reached, and joined."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Body, Response
from starlette.concurrency import run_in_threadpool

from api.dependencies import Gone, OperateCaller, Origin, Service, ServiceDep
from api.http import (
    ProblemDetails,
    StrictJsonRoute,
    invalid_fields,
    json_answer,
    problem_answers,
    translate,
)
from api.routes.cells import CellName
from api.routes.executions import UNGUARDED, join_plan, reason_not_executable
from api.routes.plans import (
    POST_PROBLEMS,
    SEARCH_PROBLEMS,
    PlanOrder,
    WithTrajectory,
    stored_plan,
)
from api.running_motion import running_motion
from api.schemas import RETARGET_EXAMPLES, PlanAnswer, RetargetRequestBody
from planner.errors import FieldError, InvalidProblem
from planner.request import states_of, target_moves, tracked_targets
from store import TICK_PASSED, AuditLine, ExecutionRow, PlanRow

router = APIRouter(route_class=StrictJsonRoute, tags=["executions"])

MOVES = ("streaming", "braking")  # states in which an execution makes its motion
LATER = 2.0  # times what the missed attempt took: the second one's lead
RetargetBody = Annotated[RetargetRequestBody, Body(openapi_examples=RETARGET_EXAMPLES)]  # type: ignore[arg-type]


@router.post(
    "/cells/{name}/retarget",
    status_code=202,
    summary="Retarget a running motion",
    responses={
        **json_answer(202, PlanAnswer, "The plan that has joined the motion.", *POST_PROBLEMS, *SEARCH_PROBLEMS),
        **problem_answers("cannot-join", "plan-not-executable"),
    },
)
async def retarget_motion(
    name: CellName,
    body: RetargetBody,
    service: ServiceDep,
    caller: OperateCaller,
    origin: Origin,
    gone: Gone,
    trajectory: WithTrajectory = True,
) -> Response:
    """Plans from the earliest tick of the running motion that can be reached, and replaces it. **Moves the robot.**

    The body is that of `POST /plan` without cell and start. The lead is the time that nine in ten of the last twenty
    calls took, at first 0.5 s. A tick that passes meanwhile is retried once, with twice the time that this took. Where
    nothing joins, the running plan goes on untouched, and the problem says why.
    """
    cell = await run_in_threadpool(service.cell, name)
    status = await run_in_threadpool(service.store.cell_status, name)
    reason = reason_not_executable(service, caller, cell, status)
    if reason is not None:
        if reason == UNGUARDED:
            raise ProblemDetails("forbidden", reason)
        raise ProblemDetails("robot-not-ready", reason, cell=name, fault=None if status is None else status.fault)
    if target_moves(body):
        tracked = [f"{path}.position.target" for path in tracked_targets(body)]
        moving = [f"{path}.velocity" for path, state in states_of(body).items() if "observed_at_s" in state]
        (field, *_) = tracked or moving
        raise InvalidProblem([FieldError(field, "is for plans: a running motion waits for no target")])
    asked = PlanOrder({**body, "cell": name}, service, None, origin.request_id, gone, trajectory)
    attempt = _Retarget(asked, name, caller.name, origin.act(caller, "replace"))
    begun_s = time.monotonic()
    try:
        plan = await attempt.make(service.leads.lead_s(name))
    except ProblemDetails as problem:
        if problem.name != "cannot-join" or not (problem.detail or "").startswith(TICK_PASSED):
            raise
        plan = await attempt.make(LATER * (time.monotonic() - begun_s))
    content = plan.document if trajectory else plan.summary
    return Response(content, 202, {"Location": f"/plans/{plan.id}"}, "application/json")


@dataclass(frozen=True)
class _Retarget:
    """One call: what is asked for, and by whom."""

    asked: PlanOrder
    cell: str
    who: str
    audit: AuditLine

    async def make(self, lead_s: float) -> PlanRow:
        """Plans from the tick that is `lead_s` [s] ahead, and has the executor go on with the plan.

        Raises:
            ProblemDetails: Nothing was planned, or it does not join; the running plan goes on.
        """
        begun_s = time.monotonic()
        service = self.asked.service
        row, now_s = await run_in_threadpool(_running, service, self.cell)
        at_s = now_s + lead_s
        if await run_in_threadpool(running_motion, service, row, at_s) is None:
            service.leads.shorten(self.cell)
            what = f"the earliest tick that can be reached is {lead_s:.2f} s ahead, at {at_s:.2f} s of the motion"
            raise ProblemDetails("cannot-join", f"{what}, which ends before")
        order = self.asked.starting({"execution": row.id, "at_s": at_s})
        plan = await _planned(order)
        try:
            await run_in_threadpool(join_plan, service, row, plan, plan.id, self.who, self.audit)
        finally:  # a search that was refused tells nothing of how long one takes
            service.leads.note(self.cell, time.monotonic() - begun_s)
        return plan


async def _planned(order: PlanOrder) -> PlanRow:
    """Returns the plan of an order that begins on the running motion, which its client did not name.

    Raises:
        ProblemDetails: It cannot begin there, or a field is refused that the client sent.
    """
    try:
        return await stored_plan(order)
    except (InvalidProblem, ProblemDetails) as refused:
        errors = translate(refused).fields.get("errors", [])
        sent = [each for each in errors if each["field"].split(".")[0] != "start"]
        if len(sent) == len(errors):
            raise
        if sent:
            raise invalid_fields(sent) from refused
        raise ProblemDetails("cannot-join", "; ".join(each["reason"] for each in errors)) from refused


def _running(service: Service, cell: str) -> tuple[ExecutionRow, float]:
    """Returns the execution that moves a cell's robot, and its clock now [s].

    Raises:
        ProblemDetails: There is none.
    """
    id = service.store.open_execution(cell)
    row = None if id is None else service.store.execution(id)
    if row is None or row.state not in MOVES:
        what = f"the execution is {row.state}" if row is not None else f"nothing runs on cell {cell!r}"
        raise ProblemDetails("cannot-join", f"{what}: there is no motion to join")
    told = service.store.newest_event(row.id, "telemetry")
    if told is None:
        raise ProblemDetails("cannot-join", "the executor has not told yet where the motion is")
    data: Any = told.data
    return row, data["clock_s"] + max(time.time() - told.at, 0.0)
