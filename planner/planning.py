"""The only entry of the planner: `plan(problem)` returns a certified motion, or raises with the reason."""

from __future__ import annotations

import time
from dataclasses import dataclass

from planner.approach import Approach
from planner.certificate import Certificate
from planner.errors import Infeasible
from planner.problem import ThrowProblem
from planner.request import request_document
from planner.search import (
    VARIANTS_BY_BACKEND,
    Attempt,
    CertifiedSolution,
    PlanningSearch,
    best_with_way_home,
    nearest_release,
    search_optimised,
    search_sequential,
    search_with_stop,
)
from planner.seeds import candidates
from planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Plan:
    """A certified motion for a problem, with the record of the search.

    Attributes:
        problem: as requested.
        backend: that made the motion.
        trajectory: the motion.
        certificate: of the motion, valid.
        status: final status of the back end, in words.
        iterations: of the back end for this motion.
        solve_time_s: duration of the whole search [s].
        attempts: log of the search.
        way_home: certified motion from the plan's end to the cell's home.
    """

    problem: ThrowProblem
    backend: str
    trajectory: Trajectory
    certificate: Certificate
    status: str
    iterations: int
    solve_time_s: float
    attempts: tuple[Attempt, ...]
    way_home: Approach


def plan(problem: ThrowProblem) -> Plan:
    """Returns the best certified motion for the problem.

    Raises:
        Infeasible: no release state or no certified motion exists; carries the violated constraints and the nearest
            feasible request.
        SolverFailed: the budget or the time limit was spent, or the back end gave up, before that was decided.
        BackendUnavailable: the requested back end is not installed.
    """
    begun_s = time.perf_counter()
    deadline_s = begun_s + problem.time_limit_s
    try:
        search, best, way_home = _search(problem, deadline_s)
    except Infeasible as refusal:
        raise _with_nearest(problem, refusal, deadline_s) from None
    return Plan(
        problem=problem,
        backend=best.backend,
        trajectory=best.solution.trajectory,
        certificate=best.certificate,
        status=best.solution.status,
        iterations=best.solution.iterations,
        solve_time_s=time.perf_counter() - begun_s,
        attempts=tuple(search.attempts),
        way_home=way_home,
    )


def _search(problem: ThrowProblem, deadline_s: float) -> tuple[PlanningSearch, CertifiedSolution, Approach]:
    """Returns a finished search, its best motion from whose end there is a way home, and that way.

    Raises:
        Infeasible, SolverFailed: there is no such motion.
    """
    search, found = PlanningSearch(problem, deadline_s), candidates(problem)
    if problem.backend in VARIANTS_BY_BACKEND:
        search_sequential(search, problem.backend, found)
    else:
        search_optimised(search, found)
    if search.incumbent is None and problem.backend == "auto":
        search_with_stop(search, found)
    if search.incumbent is None:
        raise search.failure()
    return search, *best_with_way_home(search)


def _with_nearest(problem: ThrowProblem, refusal: Infeasible, deadline_s: float) -> Infeasible:
    """Returns the refusal with the nearest feasible request."""
    release = nearest_release(problem, refusal.violations, deadline_s)
    nearest = None if release is None else request_document(problem, release)
    return Infeasible(refusal.violations, nearest, refusal.attempts)
