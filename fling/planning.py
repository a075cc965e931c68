"""Planning without a service: a request in the shape of `POST /plan`, or typed, and its certified motion."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack
from uuid import uuid4

from fling.cells import open_cell
from fling.plans import Plan
from fling.requests import Options, Request, request_of
from planner import planning
from planner.answer import iso_time, plan_document
from planner.cell import Cell
from planner.errors import FieldError, InvalidProblem
from planner.planning import SearchHints
from planner.problem import ThrowProblem
from planner.progress import Observer, ProgressMeter
from planner.request import problem_from_request, request_document

DEFAULT_CELL = "ur5e-sim"


def problem(
    request: Request,
    cell: Cell | str | Path | Mapping[str, Any] | None = None,
    **options: Unpack[Options],
) -> ThrowProblem:
    """Returns the problem that a request states, in the planner's units.

    Args:
        request: a release such as `fling.Target`, a list of `fling.Passage`, or all of it as `POST /plan` takes it.
        cell: a cell, or what `fling.open_cell` takes; by default the one that the request names, or `ur5e-sim`.
        options: what the request states beside the release.

    Raises:
        CellError: there is no such cell, or its file is refused.
        InvalidProblem: every refused field with its reason.
    """
    asked = request_of(request, options)
    if not isinstance(asked, Mapping):
        reason = f"must be a release, or a mapping as `POST /plan` takes it, or a list of passages, not {asked!r:.60}"
        raise InvalidProblem([FieldError("request", reason)])
    named = asked.get("cell") if cell is None else cell
    found = named if isinstance(named, Cell) else open_cell(DEFAULT_CELL if named is None else named)
    stated = problem_from_request(asked, found)
    if asked.get("min_hit_probability"):
        reason = "odds are reckoned by `fling plan`, `fling throw` and the service; the library plans without"
        raise InvalidProblem([FieldError("min_hit_probability", reason)])
    return stated


def plan(
    request: Request | ThrowProblem,
    cell: Cell | str | Path | Mapping[str, Any] | None = None,
    progress: Observer | None = None,
    **options: Unpack[Options],
) -> Plan:
    """Returns the best certified motion for a request.

    The first plan of a process takes longer: it loads the optimiser.

    Args:
        request: a release such as `fling.Target`, a list of `fling.Passage`, all of it as `POST /plan` takes it, or a
            problem.
        cell: a cell, or what `fling.open_cell` takes; by default the one that the request names, or `ur5e-sim`.
        progress: called with a `Progress` at each step of the search, and decides nothing; what it raises ends the
            search.
        options: what the request states beside the release, such as `release_window_s=0.01`; none for a problem.

    Raises:
        CellError: there is no such cell, or its file is refused.
        InvalidProblem: every refused field with its reason.
        Infeasible: there is no such motion, or none was found; says what stands in the way, and what near it works.
        SolverFailed: the request's time limit ended the search before that.
    """
    hints = SearchHints(meter=ProgressMeter(progress))
    if isinstance(request, ThrowProblem):
        if cell is not None or options:
            raise TypeError("a problem states its cell and options itself: dataclasses.replace(problem, ...)")
        found = planning.plan(request, hints)
        asked = request_document(request, request.release)
    else:
        found = planning.plan(problem(request, cell, **options), hints)
        asked = {**request_of(request, options), "cell": found.problem.cell.name}
    return Plan(plan_document(found, asked, str(uuid4()), iso_time(time.time())), found)
