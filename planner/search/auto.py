"""The search of `auto` and `casadi`.

1. Ruckig's soonest arrivals at a release state that is given, under the request's limits and under tighter ones: they
   take microseconds, and where nothing couples the joints, none is sooner.
2. The optimiser: from the soonest candidate of every aspect that may still be sooner than the incumbent, from a second
   one where that came to nothing, and from what is least like the answer.
3. While there is no answer: all of Ruckig's motions.

From each candidate the optimiser begins from two motions by Ruckig, the second where the first leads to nothing: that
of the request's limits, and a gentle one.

Counts alone decide what is tried, so that the answer does not depend on the load of the machine. The only clock is the
request's own deadline.
"""

from __future__ import annotations

import math
import time
from bisect import insort
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from planner.backends import casadi_nlp, ruckig_otg
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.search.incumbent import PlanningSearch, counted
from planner.search.optimise import ROUNDS, load_optimiser, optimise
from planner.search.ranking import Ranked, again, by_aspect, ranked, unlike
from planner.seeds import Candidate

ITERATIONS = 300
WINDOW_BUDGET = 1.5  # [-] of one walk over the candidates, and times as many with a release window
TIMED_MAX = 8  # [-] candidates of least bound, of a given release, of which Ruckig's own times are asked for
SEEDS_AN_ASPECT = 2  # [-] the optimiser fails from one and not from another, but rarely finds another motion
ATTEMPTS = 4  # [-] from a candidate that led to nothing, the last two only while there is no answer
UNLIKE = 1  # [-] candidates unlike the answer
MOTIONS_MAX = 24  # [-] candidates that Ruckig's motions lead to
HALVINGS = ((0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (0, 1), (0, 2))  # [-] of jerk, acceleration: of arrivals
TICK_SLACK = 1e-6  # [ticks] for rounding


def search_once(search: PlanningSearch, found: Sequence[Candidate]) -> None:
    """Searches for a motion from candidates.

    Args:
        search: updated in place.
        found: candidates of its problem, by ascending lower bound.
    """
    order = ranked(search.problem, found)
    with_ruckig = search.problem.backend == "auto"
    if with_ruckig and search.problem.fixes_joints and not search.problem.is_robust:
        _take_arrivals(search, order)
    optimise_all(search, order)
    if with_ruckig and search.incumbent is None:
        take_motions(search, order[:MOTIONS_MAX])


def _take_arrivals(search: PlanningSearch, order: Sequence[Ranked]) -> None:
    """Certifies Ruckig's soonest motions to a given release state; notes the least time in which it can be reached."""
    begun = time.perf_counter()
    problem = search.problem
    tried = 0
    valid = 0
    first = [each for _, each in zip(range(2), _by_arrival(order), strict=False)]
    if math.isfinite(first[0].arrival_s):
        ticks = max(math.ceil(first[0].arrival_s / problem.dt - TICK_SLACK), ruckig_otg.TICKS_MIN)
        search.lower_bound_s = problem.dt * (ticks + TICK_SLACK)
    for times in HALVINGS:
        tighter = replace(problem, limits=_halved(problem.limits, *times))
        for each in first:
            if not search.is_over:
                made = _motion(search, tighter, each, "free")
                tried = tried + (made is not None)
                valid = valid + bool(made)
    search.log_attempt("ruckig", f"soonest arrivals: {valid} of {tried} motions certified", begun)


def take_motions(
    search: PlanningSearch, order: Sequence[Ranked], variants: Sequence[ruckig_otg.LaunchVariant] = ruckig_otg.VARIANTS
) -> None:
    """Certifies Ruckig's motions to candidates until one is valid."""
    begun = time.perf_counter()
    tried = 0
    for each in order:
        for variant in variants:
            if search.incumbent is None and not search.is_over:
                tried += _motion(search, search.problem, each, variant) is not None
    search.log_attempt("ruckig", f"{int(search.incumbent is not None)} of {tried} motions certified", begun)


def _motion(
    search: PlanningSearch, problem: ThrowProblem, each: Ranked, variant: ruckig_otg.LaunchVariant
) -> bool | None:
    """Returns whether Ruckig's motion within a problem's limits is certified; None where there is none, or no sooner."""
    if each.candidate.bound_s >= search.release_time_s:
        return None
    try:
        solution = ruckig_otg.solve(problem, each.candidate, variant)
    except SolverFailed:
        return None
    if solution.trajectory.release_time_s >= search.release_time_s:
        return None
    return search.certify("ruckig", solution).is_valid


def optimise_all(search: PlanningSearch, order: Sequence[Ranked], most: int | None = None) -> None:
    """Optimises from candidates while they may be sooner.

    Args:
        search: updated in place.
        order: the candidates by ascending lower bound.
        most: seeds at most; None for no such number.
    """
    if search.is_over:
        return
    is_free = not search.problem.fixes_joints
    problem = search.problem
    load_optimiser(search)
    begun = time.perf_counter()
    settled = set[int]()
    tried = 0
    failure = ""
    budget = math.ceil(ITERATIONS * (WINDOW_BUDGET if problem.is_robust else 1.0))

    def walk(way: Iterable[Ranked], attempt: int = 0, is_further: bool = False) -> list[Ranked]:
        """Optimises from candidates in turn; returns those that there was no time for, and that came to nothing."""
        nonlocal tried, failure
        end = search.iterations + budget
        failed = list[Ranked]()
        for each in (rest := iter(way)):
            if search.is_over or search.iterations >= end or tried == most:
                return [each, *rest, *failed]
            least_s = each.least_s if is_free else each.arrival_s
            if not is_further and (each.aspect in settled or least_s >= search.release_time_s):
                continue
            tried += 1
            try:
                if not optimise(search, *each.guess(attempt), end, 1 if each.given else ROUNDS):
                    failed.append(each)
                elif is_free:
                    settled.add(each.aspect)
            except casadi_nlp.SeedFailed as error:
                failure = f"; {error}"
                if error.is_late and is_free:
                    settled.add(each.aspect)
                elif not error.is_late:
                    failed.append(each)
        return failed

    way: Iterable[Ranked] = by_aspect(order, SEEDS_AN_ASPECT) if is_free else _by_arrival(order)
    for attempt in range(ATTEMPTS):
        if attempt < 2 or search.incumbent is None:
            way = walk(way, attempt)
    if search.incumbent is not None and is_free:
        made = search.incumbent.solution.trajectory
        walk(unlike(order, made)[:UNLIKE], is_further=True)
        if problem.is_robust:
            walk([again(problem, search.incumbent.solution.trajectory)], is_further=True)
    if tried:
        made = f"{int(search.incumbent is not None)} answers from {counted(tried, 'candidate')}"
        search.log_attempt("casadi", made + failure, begun)


def _by_arrival(order: Sequence[Ranked]) -> Iterator[Ranked]:
    """Yields the `TIMED_MAX` of least bound by the slowest joint's own time, and times no more than it has to.

    A candidate can only arrive after its bound, so the soonest timed one comes before all with a later bound.
    """
    waiting = list(order[:TIMED_MAX])
    timed = list[Ranked]()
    while waiting or timed:
        while waiting and (not timed or waiting[0].candidate.bound_s < timed[0].arrival_s):
            insort(timed, waiting.pop(0), key=lambda each: each.arrival_s)
        yield timed.pop(0)


def _halved(limits: Limits, jerk: int, acceleration: int) -> Limits:
    """Returns limits with jerk and acceleration halved so many times."""
    return replace(limits, jerk_max=0.5**jerk * limits.jerk_max, qdd_max=0.5**acceleration * limits.qdd_max)
