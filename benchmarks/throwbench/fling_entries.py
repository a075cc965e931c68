"""Fling's own entries: its back ends as functions, and its service behind `POST /plan`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from benchmarks.throwbench.problem_document import Problem, problem_from_document
from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from planner.request import release_document

Answer = dict[str, Any]


def auto(problem: Problem) -> Answer:
    """Returns the answer of all back ends together."""
    return _planned(problem, "auto")


def casadi(problem: Problem) -> Answer:
    """Returns the answer of the optimiser."""
    return _planned(problem, "casadi")


def ruckig(problem: Problem) -> Answer:
    """Returns the answer of Ruckig between Fling's candidates."""
    return _planned(problem, "ruckig")


def toppra(problem: Problem) -> Answer:
    """Returns the answer of TOPP-RA along Fling's paths."""
    return _planned(problem, "toppra")


def _planned(problem: Problem, backend: str) -> Answer:
    try:
        motion = plan(replace(problem_from_document(problem), backend=backend)).trajectory
    except (Infeasible, SolverFailed) as refusal:
        return {"refused": str(refusal)}
    return {
        "positions": motion.q.tolist(),
        "velocities": motion.qd.tolist(),
        "release_time_s": motion.release_time_s,
    }


def service_request(problem: Problem) -> dict[str, Any]:
    """Returns the request of `POST /plan` for a problem, on the cell of its name.

    Raises:
        ValueError: The service's cell has not the surroundings of the problem: a request cannot bring boxes.
    """
    if problem["surroundings"]["keep_out"]:
        raise ValueError("a request of POST /plan cannot bring keep-out boxes: they belong to the cell")
    asked = problem_from_document(problem)
    request: dict[str, Any] = {
        "cell": problem["cell"],
        "start": problem["start"],
        "release": release_document(asked.release),
        "release_window_s": asked.release_window_s,
    }
    if asked.is_robust:
        request["landing_tolerance_m"] = asked.landing_tolerance_m
    return request


def service_answer(status: int, document: dict[str, Any]) -> Answer:
    """Returns the answer that a response of `POST /plan` is.

    Raises:
        ValueError: The response is neither a plan nor a refusal.
    """
    if "trajectory" in document:
        motion = document["trajectory"]
        answer = {key: motion[key] for key in ("positions", "velocities")}
        return answer | {"release_time_s": document["release_time_s"]}
    kind = str(document.get("type", "")).rpartition("/")[2]
    if kind in ("infeasible", "solver-failed"):
        return {"refused": str(document.get("detail"))}
    raise ValueError(f"status {status}, {kind}: {document.get('detail')}")
