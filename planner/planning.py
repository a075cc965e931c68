"""plan(): candidates, back ends, the judge, the best.

Only a certified trajectory leaves this module. `auto` optimises from the seeds that Ruckig reaches soonest, then
certifies those of Ruckig's motions that would release sooner still.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import product

from planner.certificate import Certificate, certify
from planner.errors import Infeasible, SolverFailed
from planner.problem import ThrowProblem
from planner.request import request_document
from planner.search.auto import by_launch_time, optimised
from planner.search.incumbent import Attempt, Search
from planner.search.nearest import nearest_release
from planner.search.sequential import WAYS, one_by_one
from planner.seeds.candidates import candidates
from planner.trajectory import Trajectory

NEAREST_TIME_S = 1.0  # [s] spent at most on finding what can be done instead
NEAREST_LEAST_S = 0.3  # [s] for it where the search has used up its own time
REFUSED_S = 1.45  # [s] after the request, when a refusal ought to have been given
NEAREST_SEEDS = 6  # candidates tried for each share
OPTIMISING = ("auto", "casadi")
ROBUST_TIME_S = 0.3  # [s] for the optimiser to show that a target can be hit robustly


@dataclass(frozen=True, eq=False)
class Plan:
    """A certified answer to a problem, and how it was found."""

    problem: ThrowProblem
    backend: str
    trajectory: Trajectory
    certificate: Certificate
    status: str
    iterations: int
    solve_time_s: float
    attempts: tuple[Attempt, ...]


def plan(problem: ThrowProblem) -> Plan:
    """Returns the best certified motion for the problem.

    Raises:
        Infeasible: no release state or no certified motion exists; says what stands in the way, and the nearest
            request that can be done.
        SolverFailed: time ran out, or the back end gave up, before that was decided.
        BackendUnavailable: the back end asked for is not installed.
    """
    begun = time.perf_counter()
    search = Search(problem, begun + problem.time_limit_s)
    try:
        _search(search)
    except Infeasible as refusal:
        raise _with_nearest(search, refusal) from None
    assert search.best is not None
    solution = search.best.solution
    return Plan(
        problem=problem,
        backend=search.best.backend,
        trajectory=solution.trajectory,
        certificate=search.best.certificate,
        status=solution.status,
        iterations=solution.iterations,
        solve_time_s=time.perf_counter() - begun,
        attempts=tuple(search.attempts),
    )


def _search(search: Search) -> None:
    """Fills in the best answer.

    Raises:
        Infeasible, SolverFailed: there is none.
    """
    seeds = candidates(search.problem)
    backend = search.problem.backend
    if backend in WAYS:
        one_by_one(search, backend, seeds)
    else:
        optimised(search, by_launch_time(search.problem, seeds), with_ruckig=backend == "auto")
    if search.best is None:
        raise search.refusal()


def _with_nearest(search: Search, refusal: Infeasible) -> Infeasible:
    """Returns the refusal with the closest request that certifies."""
    now = time.perf_counter()
    latest = min(search.deadline_s, now + NEAREST_TIME_S, search.begun_s + REFUSED_S)
    deadline = max(latest, now + NEAREST_LEAST_S)
    release = nearest_release(search.problem, list(refusal.violations), _certifiable, deadline)
    nearest = None if release is None else request_document(search.problem, release)
    return Infeasible(refusal.violations, nearest, refusal.attempts)


def _certifiable(problem: ThrowProblem, thorough: bool) -> bool:
    """Whether one of the first few candidates gives a certified motion, by Ruckig for a back end that optimises.

    The gentlest way comes first; the others are tried where it is worth a thorough look. A landing that must hold for
    a window of releases is the optimiser's alone: it is asked where Ruckig shows that the target can be hit at all.
    """
    if problem.is_robust and problem.backend in OPTIMISING:
        nominal = replace(problem, release_window_s=0.0)
        return _certifiable(nominal, thorough) and _optimisable(problem)
    ways = WAYS.get(problem.backend, WAYS["ruckig"])[::-1]
    try:
        seeds = candidates(problem)[: NEAREST_SEEDS if thorough else NEAREST_SEEDS // 2]
    except Infeasible:
        return False
    for solve, seed in product(ways if thorough else ways[:1], seeds):
        try:
            if certify(problem, solve(problem, seed).trajectory).valid:
                return True
        except SolverFailed:
            continue
    return False


def _optimisable(problem: ThrowProblem) -> bool:
    """Whether the optimiser gives a certified motion from its first seed."""
    search = Search(problem, time.perf_counter() + ROBUST_TIME_S)
    optimised(search, by_launch_time(problem, candidates(problem))[:1], with_ruckig=False)
    return search.best is not None
