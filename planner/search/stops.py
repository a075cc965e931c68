"""The fallback of `auto` where no motion from the start is certified: throw from an intermediate posture at rest.

The arm first goes to another posture at rest, by a planned path where the straight way is blocked, and launches from
there: from the cell's home, or from a run-up posture behind a candidate, from which constant acceleration leads into
the release. Both motions in a row are certified as one, within the limits of the request.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from planner.approach import find_approach
from planner.arrays import Array
from planner.backends import ruckig_otg
from planner.backends.solution import Solution
from planner.certificate import Examination
from planner.errors import InvalidProblem, SolverFailed, Violation, nothing_found
from planner.geometry import body_model
from planner.problem import JointRelease, ThrowProblem
from planner.search.record import CertifiedSolution, PlanningSearch, counted
from planner.search.search import CANDIDATES, MOTIONS, search_candidates, try_motions
from planner.search.way_home import WAYS_MAX
from planner.seeds import Candidate, candidates
from planner.trajectory import Trajectory, in_a_row

PACE = 4.0  # [-] of an approach, in turn with its halves: 4 rad/s, 22 rad/s^2, 900 rad/s^3, or less as the request asks
RUN_UPS_S = (0.2, 0.3, 0.5)  # [s] of constant acceleration to the release; 3 rad/s at 15 rad/s^2 take 0.2 s


def search_with_stop(search: PlanningSearch, found: Sequence[Candidate]) -> None:
    """Looks for a launch with a stop until one is certified; its status says so.

    Args:
        search: without a motion; updated in place.
        found: candidates of its problem.
    """
    begun_s = time.perf_counter()
    launches = 0
    ways = 0
    for stop, throw in _launches(search, found):
        launches += 1
        way = _way(search, stop)
        if way is not None:
            ways += 1
            motion = way if throw is None else in_a_row(way, throw.solution.trajectory)
            status = "planned path" if throw is None else f"after a stop; {throw.solution.status}"
            search.certify("approach" if throw is None else throw.backend, Solution(motion, status))
        if search.best is not None or search.out_of_time or launches == WAYS_MAX:
            break
    made = f"{counted(int(search.best is not None), 'motion')} certified"
    result = f"{made}, {counted(ways, 'way')} to {counted(launches, 'posture')}"
    if not launches:
        result = f"no posture was found to throw from{' in time' if search.out_of_time else ''}"
    search.log_attempt("approach", f"with a stop: {result}", begun_s)


def search_throw(search: PlanningSearch) -> None:
    """Searches for a throw that is a part of another motion: from its start, or else with a stop.

    Args:
        search: updated in place.

    Raises:
        Infeasible: there are no candidates.
        SolverFailed: the deadline passed before one was found.
    """
    found = candidates(search.problem, search.deadline_s)
    search_candidates(search, found)
    if search.best is None and search.problem.starts_at_rest:
        search_with_stop(search, found)


def search_after_brake(search: PlanningSearch) -> None:
    """Brakes from a start in motion as fast as the limits allow, and plans from there; its status says so.

    Args:
        search: without a motion; updated in place.
    """
    begun_s = time.perf_counter()
    problem = search.problem
    brake = certified_brake(problem)
    if isinstance(brake, Violation):
        search.log_attempt("approach", f"after a brake: {brake}", begun_s)
        return
    with search.inner(problem.at_rest_from(brake.q[-1])) as inner:
        search_throw(inner)
    if inner.best is not None:
        solution = inner.best.solution
        status = f"after a brake; {solution.status}"
        search.certify(inner.best.backend, Solution(in_a_row(brake, solution.trajectory), status))
    made = f"{counted(int(search.best is not None), 'motion')} certified"
    search.log_attempt("approach", f"after a brake: {made}", begun_s)


def certified_brake(problem: ThrowProblem) -> Trajectory | Violation:
    """Returns the fastest brake from a start in motion, or what stands in its way."""
    try:
        q, qd, qdd = ruckig_otg.leg(problem, problem.start_state, None, pace=1.0)
    except SolverFailed as failure:
        return nothing_found("motion", f"no brake from the start: {failure}")
    brake = Trajectory(1.0 / problem.dt, q, qd, qdd, release_index=len(q) - 1)
    rest = JointRelease(q[-1], np.zeros(6))
    failed = Examination(replace(problem, release=rest, passages=(), end=None), brake).first_failure
    if failed is None:
        return brake
    detail = ", ".join(filter(None, [failed.detail, "on the fastest brake from the start"]))
    return replace(failed.as_violation(), detail=detail)


def _launches(search: PlanningSearch, found: Sequence[Candidate]) -> Iterator[tuple[Array, CertifiedSolution | None]]:
    """Yields postures at rest and certified motions from them; None for the end of a move to rest itself."""
    problem = search.problem
    if problem.ends_at_rest:
        yield from ((candidate.q, None) for candidate in found)
        return
    home = problem.cell.home
    if not np.array_equal(home, problem.start) and (throw := _from(search, home, None)) is not None:
        yield home, throw
    for candidate in found[:CANDIDATES]:
        for run_up_s in RUN_UPS_S:
            stop = candidate.q - 0.5 * run_up_s * candidate.qd
            if (throw := _from(search, stop, candidate)) is not None:
                yield stop, throw
                break


def _from(search: PlanningSearch, stop: Array, candidate: Candidate | None) -> CertifiedSolution | None:
    """Returns the best certified motion from a posture, by Ruckig where a candidate is given; None if there is none."""
    if search.out_of_time or body_model(search.problem.cell_with_bin).clearances(stop[None]).least[0] < 0.0:
        return None
    try:
        problem = search.problem.at_rest_from(stop)
    except InvalidProblem:
        return None
    with search.inner(problem) as inner:
        if candidate is None:
            search_candidates(inner, candidates(problem, search.deadline_s))
        else:
            try_motions(inner, "ruckig", [candidate], MOTIONS["ruckig"])
    return inner.best


def _way(search: PlanningSearch, stop: Array) -> Trajectory | None:
    """Returns the motion from the start to a posture at rest, within the request's limits; None if none is found."""
    problem = search.problem
    limits = problem.limits
    way, _ = find_approach(
        problem.cell_with_bin, problem.start, stop, PACE, limits=limits, deadline_s=search.deadline_s
    )
    return None if way is None else way.trajectory
