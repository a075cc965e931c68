"""The only entry of the planner: `plan(problem)` returns a certified motion, or raises with the reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from planner.approach import Approach
from planner.certificate import Certificate
from planner.errors import Infeasible, SolverFailed
from planner.problem import TIME_LIMIT_S, ThrowProblem
from planner.request import request_document
from planner.search import (
    VARIANTS_BY_BACKEND,
    Attempt,
    CertifiedSolution,
    PlanningSearch,
    best_with_way_home,
    load_libraries,
    nearest_problem,
    of_candidates,
    refuse_impossible,
    search_once,
    search_sequential,
    search_with_stop,
)
from planner.seeds import Candidate, NoCandidates, ReleaseState, candidates, neighbour_candidates
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
        solve_time_s: duration of the whole search, loading of libraries and solvers excluded [s].
        attempts: log of the search.
        way_home: certified motion from the plan's end to the cell's home.
        was_cut_short: whether the time limit passed before the end of the search: more time may give a sooner release.
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
    was_cut_short: bool = False


@dataclass(frozen=True)
class SearchHints:
    """What a caller of the planner wants or knows beside the problem.

    Attributes:
        releases: release states of plans for other targets: a short search starts from these alone. Empty: an ordinary
            search from candidates of its own.
        offers_nearest: whether a refusal carries the nearest feasible request, the larger part of most refusals' time.
    """

    releases: tuple[ReleaseState, ...] = ()
    offers_nearest: bool = True


ORDINARY = SearchHints()
NO_RELEASE_STATE = "no release state was found"


def plan(problem: ThrowProblem, hints: SearchHints = ORDINARY) -> Plan:
    """Returns the best certified motion for the problem.

    The clock of `time_limit_s` starts once the libraries are loaded, and stands still while solvers are.

    Args:
        problem: to be solved.
        hints: where the search starts, and what a refusal offers.

    Raises:
        Infeasible: the search for a certified motion ran to its end in vain, or none exists; carries the constraints
            in the way, each proven or not, and the nearest feasible request.
        SolverFailed: the time limit ended the search before that; carries the same.
        BackendUnavailable: the requested back end is not installed.
    """
    load_libraries(problem.backend)
    begun_s = time.perf_counter()
    search = PlanningSearch(problem, begun_s + problem.time_limit_s)
    best, way_home = _best(search, hints)
    return Plan(
        problem=problem,
        backend=best.backend,
        trajectory=best.solution.trajectory,
        certificate=best.certificate,
        status=best.solution.status,
        iterations=best.solution.iterations,
        solve_time_s=time.perf_counter() - begun_s - search.loading_s,
        attempts=tuple(search.attempts),
        way_home=way_home,
        was_cut_short=search.was_cut_short,
    )


def _best(search: PlanningSearch, hints: SearchHints) -> tuple[CertifiedSolution, Approach]:
    """Returns the answer of a search: its best motion from whose end there is a way home, and that way.

    Raises:
        Infeasible, SolverFailed: there is none; with the nearest feasible request, if asked for.
    """
    try:
        _run(search, hints.releases)
        return best_with_way_home(search)
    except (Infeasible, SolverFailed) as refusal:
        if hints.offers_nearest:
            refusal.nearest = _nearest(search, refusal)
        raise


def _run(search: PlanningSearch, releases: Sequence[ReleaseState]) -> None:
    """Searches for a motion; from the release states of other plans, where some are given, by one walk of the policy.

    Raises:
        Infeasible, SolverFailed: there is none.
    """
    problem = search.problem
    refuse_impossible(problem)
    if releases:
        found = _found_or_logged(search, lambda problem: neighbour_candidates(problem, releases))
        search_once(search, found)
        search.note_end()
    else:
        _search_ordinarily(search)
    if search.incumbent is None:
        raise search.failure()


def _search_ordinarily(search: PlanningSearch) -> None:
    """Searches from candidates of its own, to the end.

    Raises:
        Infeasible: there are no candidates.
    """
    problem = search.problem
    found = _found_or_logged(search, candidates)
    if problem.backend in VARIANTS_BY_BACKEND:
        search_sequential(search, problem.backend, found)
    else:
        search_once(search, found)
    search.note_end()
    if search.incumbent is None and problem.backend == "auto":
        search_with_stop(search, found)


def _found_or_logged(search: PlanningSearch, find: Callable[[ThrowProblem], list[Candidate]]) -> list[Candidate]:
    """Returns the candidates that are found for a search's problem; without any, what was looked at is its attempt.

    Raises:
        Infeasible: there are none.
    """
    problem = search.problem
    begun_s = time.perf_counter()
    try:
        return find(problem)
    except Infeasible as refusal:
        tried = refusal.tried if isinstance(refusal, NoCandidates) else NO_RELEASE_STATE
        search.log_attempt("candidates", tried, begun_s)
        log = [attempt.__dict__ for attempt in search.attempts]
        raise Infeasible(of_candidates(problem, refusal.violations), attempts=log) from None


def _nearest(search: PlanningSearch, refusal: Infeasible | SolverFailed) -> dict[str, Any] | None:
    """Returns the nearest feasible request, None where none was found.

    It has the usual time limit where the request's own passed before that was found: it can be posted as it is.
    """
    found = nearest_problem(search, refusal.violations)
    if found is None:
        return None
    if search.out_of_time:
        found = replace(found, time_limit_s=max(found.time_limit_s, TIME_LIMIT_S))
    return request_document(found, found.release)
