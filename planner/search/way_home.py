"""The way home: planning returns only motions from whose end a certified way leads to the cell's home.

The way is an approach, found and certified as the executor will find it: a straight joint move first, then a planned
path. It is asked for once, for the best motion of a finished search; where there is none, the next best is taken.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

from planner.approach import Approach, find_approach, obstacle_words
from planner.certificate import Check
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed, Violation
from planner.problem import ThrowProblem
from planner.search.record import CertifiedSolution, PlanningSearch, counted

# [s] of a path home, if the request's deadline leaves it less: a motion that was found is not lost for want of that
LATE_S = 1.0
WAYS_MAX = 3  # [-] postures to or from which a way is searched for: a search in vain takes some seconds


def best_with_way_home(search: PlanningSearch) -> tuple[CertifiedSolution, Approach]:
    """Returns the best certified motion of a finished search whose end has a way home, and that way.

    Raises:
        Infeasible: there is no motion, or none with a way home: the violation `way_home` names what blocks the
            straight move from the best one.
        SolverFailed: the same, of a search that the time limit ended, or that left ways untried for want of time.
    """
    if search.best is None:
        raise search.failure(search.violations())
    begun_s = time.perf_counter()
    deadline_s = max(search.deadline_s, begun_s + LATE_S)
    blocked = []
    motions = search.by_rank()[:WAYS_MAX]
    for motion in motions:
        way, failures = find_way_home(search.problem, motion, deadline_s)
        if way is not None:
            if blocked:
                search.log_attempt("approach", f"way home: none from {counted(len(blocked), 'sooner motion')}", begun_s)
            return motion, way
        blocked.append(failures)
        if search.out_of_time:
            break
    search.log_attempt("approach", f"way home: none from {counted(len(blocked), 'motion')}", begun_s)
    violations = [_violation(blocked[0], len(blocked))]
    is_cut_short = search.was_cut_short or time.perf_counter() >= deadline_s
    if is_cut_short or len(blocked) < len(motions):
        raise SolverFailed(TIME_LIMIT, search.iterations, search.log, violations)
    raise Infeasible(violations, attempts=search.log)


def find_way_home(
    problem: ThrowProblem, motion: CertifiedSolution, deadline_s: float = math.inf
) -> tuple[Approach | None, tuple[Check, ...]]:
    """Returns the way home from the end of a motion: without the object after a throw, with it otherwise.

    Without one, the checks that a straight move home fails. After the deadline, on `time.perf_counter`, a straight move
    alone is tried.
    """
    cell = problem.cell_with_bin
    end = motion.solution.trajectory.q[-1]
    return find_approach(cell, end, cell.home, with_object=not problem.throws, deadline_s=deadline_s)


def _violation(failures: tuple[Check, ...], tried: int) -> Violation:
    """Returns what blocks the way home from the best of the motions that were tried."""
    worst = failures[0]
    motions = counted(tried, "certified motion")
    straight = obstacle_words(failures)
    detail = f"no certified way to the cell's home from the end of {motions}; a straight move: {straight}"
    return replace(worst.as_violation(), constraint="way_home", detail=detail)
