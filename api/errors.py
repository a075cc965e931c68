"""Every error the service answers: one table of problem types, and which exception becomes which.

RFC 9457; `type` is `/problems/<name>`, a page made from this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from planner.errors import BackendUnavailable, CellError, Infeasible, InvalidProblem, SolverFailed
from store import CellBusy, KeyTaken, StoreUnavailable, UnknownExecution, UnknownPlan


@dataclass(frozen=True)
class ProblemType:
    """A kind of error: its status, its title, and what a person does about it."""

    status: int
    title: str
    explanation: str


PROBLEMS: dict[str, ProblemType] = {
    "unauthenticated": ProblemType(
        401, "Who are you?", "Send 'Authorization: Bearer <token>'. Make a token with 'fling token create'."
    ),
    "forbidden": ProblemType(
        403, "Not allowed", "The token lacks the scope, or the service runs without tokens and the cell is a real arm."
    ),
    "not-found": ProblemType(404, "No such thing", "No plan, execution, cell, recording or page has this name."),
    "method-not-allowed": ProblemType(405, "Not that way", "The address exists, but not for this method; see /docs."),
    "robot-busy": ProblemType(
        409, "The robot is busy", "One execution a cell at a time: wait until it has finished, or abort it."
    ),
    "robot-not-ready": ProblemType(
        409, "The robot is not ready", "No executor serves the cell, or the robot's state forbids motion: see 'detail'."
    ),
    "plan-not-executable": ProblemType(
        409, "This plan cannot be executed", "The cell file changed since, or the certificate is not valid: plan again."
    ),
    "too-large": ProblemType(413, "Too large", "A body may have one megabyte at most."),
    "unsupported-media-type": ProblemType(415, "Not JSON", "Send JSON with 'Content-Type: application/json'."),
    "invalid-request": ProblemType(422, "The request is wrong", "'errors' lists every refused field with its reason."),
    "infeasible": ProblemType(
        422,
        "The arm cannot do this",
        "'violations' says what stands in the way and by how much; 'nearest' is the closest the cell can do, or null.",
    ),
    "idempotency-conflict": ProblemType(
        422, "The key was used for something else", "An Idempotency-Key stands for one body. Use a fresh key."
    ),
    "overloaded": ProblemType(429, "Too much to plan", "The planning queue is full: try again after 'Retry-After'."),
    "internal": ProblemType(500, "A bug in Fling", "The log of the service has the details. Please report it."),
    "solver-failed": ProblemType(
        503, "The solver gave up", "It found no answer within 'time_limit_s'. Allow more time or another back end."
    ),
    "not-ready": ProblemType(503, "Not ready", "The store cannot be reached, or the planner is still starting."),
}


class Problem(Exception):
    """An error on its way to the client: its type, the detail in words, fields of its own, and headers."""

    def __init__(self, name: str, detail: str, *, headers: Mapping[str, str] | None = None, **fields: Any) -> None:
        super().__init__(detail)
        self.name = name
        self.detail = detail
        self.fields = fields
        self.headers = dict(headers or {})


def invalid(field: str, reason: str) -> Problem:
    """Returns the problem of one refused field."""
    return Problem("invalid-request", f"{field}: {reason}", errors=[{"field": field, "reason": reason}])


def from_status(status: int, detail: str, headers: Mapping[str, str] | None = None) -> Problem:
    """Returns the problem for an error that the framework made by its status alone."""
    if status == 400:  # a body that is not JSON
        return invalid("body", detail)
    names = {problem.status: name for name, problem in PROBLEMS.items() if name not in ("not-ready", "solver-failed")}
    return Problem(names.get(status, "internal"), detail, headers=headers)


def _invalid_problem(error: InvalidProblem) -> Problem:
    return Problem("invalid-request", str(error), errors=[vars(e) for e in error.errors])


def _infeasible(error: Infeasible) -> Problem:
    violations = [vars(violation) for violation in error.violations]
    fields = {"violations": violations, "nearest": error.nearest, "attempts": list(error.attempts)}
    return Problem("infeasible", str(error), **fields)


def _solver_failed(error: SolverFailed) -> Problem:
    fields = {"solver_status": error.status, "iterations": error.iterations, "attempts": list(error.attempts)}
    return Problem("solver-failed", f"the solver gave up: {error.status}", **fields)


def _unavailable(error: BackendUnavailable) -> Problem:
    return invalid("backend", str(error))


def _cell(error: CellError) -> Problem:
    return invalid("cell", f"the cell file is refused: {error}")


def _busy(error: CellBusy) -> Problem:
    return Problem("robot-busy", str(error), cell=error.cell)


def _key_taken(error: KeyTaken) -> Problem:
    return Problem("idempotency-conflict", "this Idempotency-Key was used with another body")


def _unavailable_store(error: StoreUnavailable) -> Problem:
    return Problem("not-ready", "the store cannot be reached", headers={"Retry-After": "1"})


def _unknown(error: Exception) -> Problem:
    return Problem("not-found", str(error))


TRANSLATIONS: dict[type[Exception], Any] = {
    InvalidProblem: _invalid_problem,
    Infeasible: _infeasible,
    SolverFailed: _solver_failed,
    BackendUnavailable: _unavailable,
    CellError: _cell,
    StoreUnavailable: _unavailable_store,
    CellBusy: _busy,
    KeyTaken: _key_taken,
    UnknownPlan: _unknown,
    UnknownExecution: _unknown,
}


def translate(error: Exception) -> Problem:
    """Returns the problem of an error of the planner or the store."""
    return TRANSLATIONS[type(error)](error)
