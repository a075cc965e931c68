"""The problem types, and the problems of the planner's errors: what service and command line answer alike.

RFC 9457: `type` is `/problems/<name>`, a page generated from this table. A new error is one line here. Nothing of the
web is imported: the command line answers a slip without loading the service.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from planner.errors import (
    ERRORS_MAX,
    BackendUnavailable,
    CellError,
    FileRefused,
    Infeasible,
    InvalidProblem,
    PlannerError,
    SolverFailed,
)


@dataclass(frozen=True)
class ProblemType:
    """One kind of error: its status, its title, and advice for the client."""

    status: int
    title: str
    explanation: str


PROBLEM_TYPES: dict[str, ProblemType] = {
    "bad-request": ProblemType(400, "Not HTTP", "What arrived on the connection is no HTTP request."),
    "unauthenticated": ProblemType(
        401, "A token is needed", "Send 'Authorization: Bearer <token>'. Create a token with 'fling token create'."
    ),
    "forbidden": ProblemType(
        403, "Not allowed", "The token lacks the scope, or the service runs without tokens and the cell is a real arm."
    ),
    "not-found": ProblemType(
        404, "Not found", "No plan, batch, map, execution, experiment, cell, profile, recording or page has this name."
    ),
    "method-not-allowed": ProblemType(
        405, "Method not allowed", "The address exists, but does not accept this method; see /docs."
    ),
    "not-acceptable": ProblemType(
        406, "Not acceptable", "'offers' lists the media types that there are: name one in 'Accept'."
    ),
    "request-timeout": ProblemType(
        408, "Too slow", "Headers and body of a request must each arrive within ten seconds: send it again."
    ),
    "robot-busy": ProblemType(
        409, "The robot is busy", "A cell runs one execution at a time: wait until it has finished, or abort it."
    ),
    "robot-not-ready": ProblemType(
        409, "The robot is not ready", "No executor serves the cell, or the robot's state forbids motion: see 'detail'."
    ),
    "plan-not-executable": ProblemType(
        409,
        "This plan cannot be executed",
        "The cell file or the adopted profile has changed, or the certificate is not valid: plan again.",
    ),
    "cannot-join": ProblemType(
        409,
        "This plan cannot replace the running one",
        "'detail' says what does not fit: its tick has passed, its position, velocity or acceleration is another, or "
        "it is another cell's. The running plan goes on untouched.",
    ),
    "cell-changed": ProblemType(
        409,
        "The cell has changed",
        "What was asked for rests on a cell file that is not there any more: plan again.",
    ),
    "executor-lost": ProblemType(
        409,
        "The executor does not report",
        "The execution's executor does not report: nobody can be asked to brake. Use the emergency stop. The request "
        "is kept for an executor that returns.",
    ),
    "nothing-thrown": ProblemType(
        409, "Nothing was thrown", "A landing belongs to an execution that let go of its object: see 'detail'."
    ),
    "profile-not-adoptable": ProblemType(
        409, "This profile cannot be adopted", "The cell file has changed since: estimate a new profile."
    ),
    "too-large": ProblemType(413, "Too large", "A request body may have at most one megabyte."),
    "unsupported-media-type": ProblemType(415, "Not JSON", "Send JSON with 'Content-Type: application/json'."),
    "invalid-request": ProblemType(
        422, "The request is invalid", "'errors' lists the refused fields with their reasons, 20 at most."
    ),
    "infeasible": ProblemType(
        422,
        "The arm cannot do this",
        "'violations' lists the constraints in the way and by how much: 'proven' where no motion can avoid them, else "
        "the search ran to its end without one that does; 'attempts' is what was tried, 'nearest' a feasible request "
        "near it, or null: there may be a nearer one.",
    ),
    "idempotency-conflict": ProblemType(
        422, "The idempotency key is taken", "An Idempotency-Key belongs to one request body. Use a new key."
    ),
    "overloaded": ProblemType(
        429, "Too many planning requests", "The planning queue is full: try again after 'Retry-After'."
    ),
    "internal": ProblemType(500, "A bug in Fling", "The service's log has the details. Please report it."),
    "solver-failed": ProblemType(
        503,
        "Planning timed out",
        "'time_limit_s' passed before it was decided whether there is a motion ('solver.status' is 'time_limit'), or a "
        "planner process ended: allow more time. 'violations' are what stood in the way of the "
        "best motion so far, 'nearest' is a feasible request near it, or null.",
    ),
    "shutting-down": ProblemType(
        503,
        "The service is shutting down",
        "It finishes what it began and takes no new plans or executions: try again after 'Retry-After'.",
    ),
    "not-ready": ProblemType(503, "Not ready", "The store cannot be reached, or the planner is still starting."),
}


def retry_after(seconds: int) -> dict[str, str]:
    """Returns the header that tells a client when to try again [s]."""
    return {"Retry-After": str(seconds)}


class ProblemDetails(Exception):
    """An error response: problem type, detail in words, extra fields and headers.

    Args:
        name: Key of `PROBLEM_TYPES`.
        detail: What went wrong with this request.
        headers: Extra response headers.
        **fields: Extra members of the JSON document.
    """

    def __init__(self, name: str, detail: str, *, headers: Mapping[str, str] | None = None, **fields: Any) -> None:
        super().__init__(detail)
        self.name = name
        self.detail = detail
        self.fields = fields
        self.headers = dict(headers or {})


def invalid_field(field: str, reason: str) -> ProblemDetails:
    """Returns the problem of a single refused field."""
    return invalid_fields([{"field": field, "reason": reason}])


def invalid_fields(errors: Sequence[Mapping[str, str]]) -> ProblemDetails:
    """Returns the problem of refused fields, the first `ERRORS_MAX` of them: each with `field` and `reason`."""
    told = list(errors[:ERRORS_MAX])
    detail = "; ".join(f"{error['field']}: {error['reason']}" for error in told)
    return ProblemDetails("invalid-request", detail, errors=told)


def internal() -> ProblemDetails:
    """Returns the problem of a bug."""
    return ProblemDetails("internal", "an internal error; the service's log has the details")


def _infeasible(error: Infeasible) -> ProblemDetails:
    return ProblemDetails("infeasible", str(error), **_refusal(error))


def _solver_failed(error: SolverFailed) -> ProblemDetails:
    solver = {"status": error.status, "iterations": error.iterations}
    return ProblemDetails("solver-failed", f"planning ended early: {error}", solver=solver, **_refusal(error))


def _refusal(error: Infeasible | SolverFailed) -> dict[str, Any]:
    """Returns what both refusals of a planning request carry."""
    violations = [vars(violation) for violation in error.violations]
    return {"violations": violations, "nearest": error.nearest, "attempts": list(error.attempts)}


def problem_document(problem: ProblemDetails, instance: str) -> dict[str, Any]:
    """Returns the JSON document of a problem (RFC 9457).

    Args:
        problem: The error.
        instance: Path of the request.
    """
    kind = PROBLEM_TYPES[problem.name]
    head = {"type": f"/problems/{problem.name}", "title": kind.title, "status": kind.status, "detail": problem.detail}
    taken = {*head, "instance"} & problem.fields.keys()
    if taken:
        raise ValueError(f"{sorted(taken)} belong to the problem itself")
    return {**head, "instance": instance, **_finite(problem.fields)}


def problem_status(problem: ProblemDetails) -> int:
    """Returns the status of a problem."""
    return PROBLEM_TYPES[problem.name].status


def _finite(value: Any) -> Any:
    """Returns `value` with null in place of NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


PLANNER_PROBLEMS: dict[type[Exception], Callable[[Any], ProblemDetails]] = {
    InvalidProblem: lambda e: ProblemDetails("invalid-request", str(e), errors=[vars(field) for field in e.errors]),
    Infeasible: _infeasible,
    SolverFailed: _solver_failed,
    BackendUnavailable: lambda e: invalid_field("backend", str(e)),
    CellError: lambda e: invalid_field("cell", f"the cell file is refused: {e}"),
    FileRefused: lambda e: invalid_field("file", str(e)),
}


def planner_problem(error: PlannerError) -> ProblemDetails:
    """Returns the problem of an error of the planner; that of a bug for one that a request does not cause."""
    kind = next((kind for kind in type(error).__mro__ if kind in PLANNER_PROBLEMS), None)
    return internal() if kind is None else PLANNER_PROBLEMS[kind](error)
