"""Planning without a service: a request in the shape of `POST /plan`, and the plan as an object or as a document."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

from fling.cells import open_cell
from planner import planning
from planner.answer import iso_time
from planner.answer import plan_document as document_of
from planner.cell import Cell
from planner.errors import FieldError, InvalidProblem
from planner.planning import Plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request, request_document

DEFAULT_CELL = "ur5e-sim"


def problem(request: Mapping[str, Any], cell: Cell | str | Path | None = None) -> ThrowProblem:
    """Returns the problem that a request states, in the planner's units.

    Args:
        request: as `POST /plan` takes it.
        cell: a cell, or its name or file; by default the one that the request names, or `ur5e-sim`.

    Raises:
        CellError: there is no such cell, or its file is refused.
        InvalidProblem: every refused field with its reason.
    """
    if not isinstance(request, Mapping):
        raise InvalidProblem(
            [FieldError("request", f"must be a mapping as `POST /plan` takes it, not {request!r:.60}")]
        )
    named = request.get("cell") if cell is None else cell
    found = named if isinstance(named, Cell) else open_cell(DEFAULT_CELL if named is None else str(named))
    asked = problem_from_request(request, found)
    if request.get("min_hit_probability"):
        reason = "odds are reckoned by `fling plan`, `fling throw` and the service; the library plans without"
        raise InvalidProblem([FieldError("min_hit_probability", reason)])
    return asked


def plan(request: Mapping[str, Any] | ThrowProblem, cell: Cell | str | Path | None = None) -> Plan:
    """Returns the best certified motion for a request.

    The first plan of a process takes seconds longer: it loads the optimiser.

    Args:
        request: as `POST /plan` takes it, or a problem.
        cell: a cell, or its name or file; by default the one that the request names, or `ur5e-sim`.

    Raises:
        CellError: there is no such cell, or its file is refused.
        InvalidProblem: every refused field with its reason.
        Infeasible: there is no such motion, or none was found; says what stands in the way, and what is nearest.
        SolverFailed: the request's time limit ended the search before that.
    """
    return planning.plan(request if isinstance(request, ThrowProblem) else problem(request, cell))


def plan_document(plan: Plan, request: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Returns a plan as JSON, as `fling plan` writes it and `fling report` reads it.

    Args:
        plan: from `plan()`.
        request: the request that it answers; by default the one that states its problem.
    """
    asked = request_document(plan.problem, plan.problem.release) if request is None else request
    return document_of(plan, {"cell": plan.problem.cell.name, **asked}, str(uuid4()), iso_time(time.time()))
