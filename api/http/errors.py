"""Problem types of the service in one table, and the translation of exceptions into them.

RFC 9457: `type` is `/problems/<name>`, a page generated from this table. A new error is one line here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from api.planning import PlanningQueueFull
from planner.errors import BackendUnavailable, CellError, Infeasible, InvalidProblem, SolverFailed
from store import CellBusy, KeyTaken, StoreUnavailable, UnknownExecution, UnknownPlan


@dataclass(frozen=True)
class ProblemType:
    """One kind of error: its status, its title, and advice for the client."""

    status: int
    title: str
    explanation: str


PROBLEM_TYPES: dict[str, ProblemType] = {
    "unauthenticated": ProblemType(
        401, "A token is needed", "Send 'Authorization: Bearer <token>'. Create a token with 'fling token create'."
    ),
    "forbidden": ProblemType(
        403, "Not allowed", "The token lacks the scope, or the service runs without tokens and the cell is a real arm."
    ),
    "not-found": ProblemType(404, "Not found", "No plan, execution, cell, recording or page has this name."),
    "method-not-allowed": ProblemType(
        405, "Method not allowed", "The address exists, but does not accept this method; see /docs."
    ),
    "robot-busy": ProblemType(
        409, "The robot is busy", "A cell runs one execution at a time: wait until it has finished, or abort it."
    ),
    "robot-not-ready": ProblemType(
        409, "The robot is not ready", "No executor serves the cell, or the robot's state forbids motion: see 'detail'."
    ),
    "plan-not-executable": ProblemType(
        409, "This plan cannot be executed", "The cell file has changed or the certificate is not valid: plan again."
    ),
    "too-large": ProblemType(413, "Too large", "A request body may have at most one megabyte."),
    "unsupported-media-type": ProblemType(415, "Not JSON", "Send JSON with 'Content-Type: application/json'."),
    "invalid-request": ProblemType(
        422, "The request is invalid", "'errors' lists every refused field with its reason."
    ),
    "infeasible": ProblemType(
        422,
        "The arm cannot do this",
        "'violations' lists the violated constraints and by how much; 'nearest' is the closest feasible request, or "
        "null.",
    ),
    "idempotency-conflict": ProblemType(
        422, "The idempotency key is taken", "An Idempotency-Key belongs to one request body. Use a new key."
    ),
    "overloaded": ProblemType(
        429, "Too many planning requests", "The planning queue is full: try again after 'Retry-After'."
    ),
    "internal": ProblemType(500, "A bug in Fling", "The service's log has the details. Please report it."),
    "solver-failed": ProblemType(
        503, "The solver gave up", "It found no answer within 'time_limit_s'. Allow more time or another back end."
    ),
    "not-ready": ProblemType(503, "Not ready", "The store cannot be reached, or the planner is still starting."),
}


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
    return ProblemDetails("invalid-request", f"{field}: {reason}", errors=[{"field": field, "reason": reason}])


def from_status(status: int, detail: str, headers: Mapping[str, str] | None = None) -> ProblemDetails:
    """Returns the problem for an error status that the framework raised."""
    if status == 400:  # a body that is not JSON
        return invalid_field("body", detail)
    names = {kind.status: name for name, kind in PROBLEM_TYPES.items() if name not in ("not-ready", "solver-failed")}
    return ProblemDetails(names.get(status, "internal"), detail, headers=headers)


def translate(error: Exception) -> ProblemDetails:
    """Returns the problem for an exception of planner, planner pool or store."""
    return TRANSLATIONS[type(error)](error)


def _invalid_problem(error: InvalidProblem) -> ProblemDetails:
    return ProblemDetails("invalid-request", str(error), errors=[vars(e) for e in error.errors])


def _infeasible(error: Infeasible) -> ProblemDetails:
    violations = [vars(violation) for violation in error.violations]
    fields = {"violations": violations, "nearest": error.nearest, "attempts": list(error.attempts)}
    return ProblemDetails("infeasible", str(error), **fields)


def _solver_failed(error: SolverFailed) -> ProblemDetails:
    fields = {"solver_status": error.status, "iterations": error.iterations, "attempts": list(error.attempts)}
    return ProblemDetails("solver-failed", f"the solver gave up: {error.status}", **fields)


def _backend_unavailable(error: BackendUnavailable) -> ProblemDetails:
    return invalid_field("backend", str(error))


def _cell_refused(error: CellError) -> ProblemDetails:
    return invalid_field("cell", f"the cell file is refused: {error}")


def _queue_full(error: PlanningQueueFull) -> ProblemDetails:
    return ProblemDetails("overloaded", str(error), headers={"Retry-After": str(error.retry_after_s)})


def _cell_busy(error: CellBusy) -> ProblemDetails:
    return ProblemDetails("robot-busy", str(error), cell=error.cell)


def _key_taken(error: KeyTaken) -> ProblemDetails:
    return ProblemDetails("idempotency-conflict", "this Idempotency-Key was used with another body")


def _store_unavailable(error: StoreUnavailable) -> ProblemDetails:
    return ProblemDetails("not-ready", "the store cannot be reached", headers={"Retry-After": "1"})


def _unknown_id(error: Exception) -> ProblemDetails:
    return ProblemDetails("not-found", str(error))


TRANSLATIONS: dict[type[Exception], Callable[[Any], ProblemDetails]] = {
    InvalidProblem: _invalid_problem,
    Infeasible: _infeasible,
    SolverFailed: _solver_failed,
    BackendUnavailable: _backend_unavailable,
    CellError: _cell_refused,
    PlanningQueueFull: _queue_full,
    StoreUnavailable: _store_unavailable,
    CellBusy: _cell_busy,
    KeyTaken: _key_taken,
    UnknownPlan: _unknown_id,
    UnknownExecution: _unknown_id,
}
