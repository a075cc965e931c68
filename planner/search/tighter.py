"""Answers under tighter limits: whatever keeps half of a limit keeps the limit.

A search that had to give up a seed may have missed what it would find with less: the optimiser starts from Ruckig's
motions, and these change with the limits, and so does the local minimum next to them. So a doubtful search is repeated
with half of the jerk and half of the acceleration, and what it finds sooner is an answer, too. A request is thereby
answered wherever one with half of its limits is, and about as soon. To a given release state, Ruckig's motions under
several pairs of tighter limits are tried in any case.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from planner.cell import Limits
from planner.errors import Infeasible
from planner.search.auto import search_optimised
from planner.search.incumbent import PlanningSearch, certified
from planner.search.policy import LAST_POLICY, SLOWER_POLICY, TIGHTER_POLICY, Stage, release_state_given
from planner.search.ranking import Ranking
from planner.seeds import Candidate, candidates

HALF = 0.5  # [-] of a limit
LEVELS = 2  # [-] times that the jerk is halved, the second time where the first gave nothing
SLOWER_JERK, SLOWER_ACCELERATION = 5, 2  # [-] times that each is halved, for Ruckig's motions to a given state


def search_thoroughly(search: PlanningSearch, found: list[Candidate]) -> None:
    """Searches under the request's own limits, where that is doubtful under tighter ones, and by the second solver.

    Args:
        search: updated in place.
        found: candidates of its problem.
    """
    ranking = Ranking(search.problem, found)
    search_optimised(search, ranking)
    if search.problem.backend == "auto" and release_state_given(search, ranking):
        search_slower(search, found)
    if is_doubtful(search):
        search_tighter(search, found)
    search_optimised(search, ranking, LAST_POLICY)


def is_doubtful(search: PlanningSearch) -> bool:
    """Returns whether a search may have missed a sooner motion: it gave up a seed, or certified none at all."""
    return not (search.is_optimal or search.out_of_time) and (search.incumbent is None or search.given_up > 0)


def search_tighter(search: PlanningSearch, found: list[Candidate]) -> None:
    """Repeats a search with tighter limits; what is sooner becomes the incumbent.

    Args:
        search: updated in place.
        found: candidates of its problem.
    """
    begun_s, limits = time.perf_counter(), search.problem.limits
    gained = any(_gains(search, found, each) for each in _with_less_jerk(limits))
    gained |= _gains(search, None, replace(limits, qdd_max=HALF * limits.qdd_max))
    result = "a sooner motion" if gained else "nothing sooner"
    search.log_attempt("casadi", f"half the jerk, half the acceleration: {result}", begun_s)


def search_slower(search: PlanningSearch, found: list[Candidate]) -> None:
    """Takes the soonest of Ruckig's motions to a given release state under tighter limits, where it is an improvement.

    They are other curves between the same states, so one of them may be clear of what the soonest one meets. A request
    with four times the jerk, or twice the acceleration, tries most of this one's, too.

    Args:
        search: updated in place.
        found: candidates of its problem.
    """
    begun_s, limits = time.perf_counter(), search.problem.limits
    shares = itertools.product(range(SLOWER_ACCELERATION + 1), range(SLOWER_JERK + 1))
    slower = (
        replace(limits, qdd_max=HALF**i * limits.qdd_max, jerk_max=HALF**k * limits.jerk_max)
        for i, k in shares
        if i + k > 0
    )
    gained = [_gains(search, found, each, SLOWER_POLICY) for each in slower]
    if any(gained):
        search.log_attempt("ruckig", "slower arrivals: a sooner motion", begun_s)


def _with_less_jerk(limits: Limits) -> Iterator[Limits]:
    for level in range(1, LEVELS + 1):
        yield replace(limits, jerk_max=HALF**level * limits.jerk_max)


def _gains(
    search: PlanningSearch,
    found: list[Candidate] | None,
    limits: Limits,
    policy: Sequence[Stage] = TIGHTER_POLICY,
) -> bool:
    """Returns whether a motion within tighter limits is sooner than the incumbent, and takes it.

    Args:
        search: updated in place.
        found: candidates within these limits, or the looser ones of the request; None to look for them.
        limits: the tighter ones.
        policy: what is tried.
    """
    if search.out_of_time or search.is_optimal:
        return False
    problem = replace(search.problem, limits=limits)
    inner, before_s = search.continued(problem), search.release_time_s
    try:
        search_optimised(inner, Ranking(problem, candidates(problem) if found is None else found), policy)
    except Infeasible:
        return False
    search.iterations += inner.iterations
    search.extend_deadline(inner.loading_s)
    for motion in inner.certified:
        search.consider(certified(motion.backend, search.problem, motion.solution))
    return search.release_time_s < before_s
