"""What a planner process does: one request in, the bytes of a plan or a refusal out.

Answers are plain data, because exceptions with fields do not survive the way between processes.
"""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import parent_process
from typing import Any

import orjson

from planner.cell import Cell, parse_cell
from planner.errors import BackendUnavailable, CellError, Infeasible, InvalidProblem, PlannerError, SolverFailed

NICENESS = 10  # a plan can wait for the stream to the arm, never the other way round


@dataclass(frozen=True)
class Job:
    """One request: contract JSON, and the text of its cell file."""

    plan_id: str
    created_at: str
    cell_name: str
    cell_text: bytes
    request: Mapping[str, Any]


@dataclass(frozen=True)
class Planned:
    """A certified plan: its JSON with and without the trajectory."""

    backend: str
    document: bytes
    summary: bytes


@dataclass(frozen=True)
class Refused:
    """Why there is none: the class of the planner's error and what it was made of."""

    kind: str
    arguments: tuple[Any, ...]

    def raise_again(self) -> None:
        """Raises the planner's error."""
        raise ERRORS[self.kind](*self.arguments)


ERRORS: dict[str, type[PlannerError]] = {
    kind.__name__: kind for kind in (InvalidProblem, Infeasible, SolverFailed, BackendUnavailable, CellError)
}


def start(warm_up: Job | None) -> None:
    """Makes this process a planner: polite, bound to its parent's life, and warm."""
    os.nice(NICENESS)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    _build_solvers()
    if warm_up is not None:
        solve(warm_up)
    gc.collect()
    gc.freeze()  # what is loaded stays; looking through it again and again would cost milliseconds a plan


def solve(job: Job) -> Planned | Refused:
    """Plans one request."""
    from planner.plan_document import plan_document, problem_from_request
    from planner.planning import plan

    try:
        problem = problem_from_request(job.request, _cell(job.cell_text, job.cell_name))
        answer = plan_document(plan(problem), job.request, job.plan_id, job.created_at)
    except PlannerError as error:
        return _refused(error)
    whole = orjson.dumps(answer, option=orjson.OPT_SERIALIZE_NUMPY)
    del answer["trajectory"]
    return Planned(answer["backend"], whole, orjson.dumps(answer, option=orjson.OPT_SERIALIZE_NUMPY))


def _refused(error: PlannerError) -> Refused:
    match error:
        case InvalidProblem():
            return Refused("InvalidProblem", (error.errors,))
        case Infeasible():
            return Refused("Infeasible", (error.violations, error.nearest, error.attempts))
        case SolverFailed():
            return Refused("SolverFailed", (error.status, error.iterations, error.attempts))
        case BackendUnavailable():
            return Refused("BackendUnavailable", (error.backend, error.extra))
        case CellError():
            return Refused("CellError", (error.field, str(error.value), error.reason))
    raise error


def _build_solvers() -> None:
    """Builds the optimiser's solvers from what `fling warm` compiled, or interpreted: never a compile here."""
    from planner.backends.casadi_nlp import build_solvers

    build_solvers()


@lru_cache(maxsize=32)
def _cell(text: bytes, name: str) -> Cell:
    return parse_cell(text, name)


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(0)
