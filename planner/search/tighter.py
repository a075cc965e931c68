"""Answers of other searches: with torque held from the first solve, under tighter limits, and without a window.

The optimiser starts from Ruckig's motions, and these change with the limits, and so does the local minimum next to
them. So a doubtful search is repeated: first with the rows of torque and tool speed included from the beginning instead
of when a solution breaks them, then as for requests with half of the jerk, a quarter of it and so on, and with half of
the acceleration. Where there is an optimised answer, that is done with half of the jerk alone (of a throw to a target
with a quarter, too), and only from the candidates that led to no motion. Of all these the first seeds come first, and
further ones follow where there is no answer or a slow one with a release window. Whatever keeps half of a limit keeps
the limit, so what is found sooner is an answer, too. Thereby a request is answered almost wherever one with half of its
limits is, and about as soon. Where a release window leaves no answer, the motions without it are where the optimiser
starts from. To a given release state, Ruckig's motions under several pairs of tighter limits are tried before the
optimiser, unless the soonest arrival is certified: they are soon made, and none is sooner where one of them reaches the
lower bound. Others follow after it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.cell import Limits
from planner.errors import Infeasible
from planner.problem import TargetRelease, ThrowProblem
from planner.search.auto import search_optimised
from planner.search.incumbent import PlanningSearch, certified, counted
from planner.search.policy import (
    AGAIN_POLICY,
    FIRST_AGAIN_POLICY,
    FROM_NOMINAL_POLICY,
    LAST_POLICY,
    SLOWER_POLICY,
    SOONER_POLICY,
    Stage,
    release_state_given,
)
from planner.search.ranking import Ranking, released
from planner.seeds import Candidate, candidates

# [s] The jerk is halved until an acceleration takes as long to its limit; requests that are looser come to that, too.
RAMP_S = 0.1
HALVINGS_MIN = 2
HALVINGS_MAX = 5  # [-] times that it is halved; each is a search or two
FEW_HALVINGS_TO_TARGET = 2
FEW_HALVINGS = 1  # [-] times where something was optimised
TINY_S = 1e-9  # [s] stands for the ramp of an infinite jerk
TORQUE = frozenset({"effort"})  # rows without which a throw's first solution is often far from any that has them
# [-] of jerk and acceleration, for Ruckig's motions to a given state. Of 701 poses 173 have a sooner arrival by one of
# the first seven, and four by both halved, all of which the optimiser undercuts; the last three are there for requests
# with twice the acceleration.
SLOWER_HALVINGS = (*((times, 0) for times in range(1, 6)), (0, 1), (0, 2), *((times, 1) for times in range(1, 4)))
SOONER_HALVINGS = ((1, 0),)  # [-] of jerk and acceleration, for all variants of these motions


def search_thoroughly(search: PlanningSearch, found: list[Candidate]) -> None:
    """Searches under the request's own limits, where that is doubtful once more, and by the second solver.

    Args:
        search: updated in place.
        found: candidates of its problem.
    """
    ranking = Ranking(search.problem, found)
    with_slower = search.problem.backend == "auto" and release_state_given(search, ranking)
    if with_slower:
        search_optimised(search, ranking, SLOWER_POLICY)
        if search.is_optimal:  # as half of the poses are: the rest would only find that out again
            return
        search_slower(search, found)
    search_optimised(search, ranking)
    if with_slower and search.incumbent is not None:
        search_sooner(search, found)
    if search.incumbent is None and search.problem.is_robust:
        search_from_nominal(search)
    if is_doubtful(search, ranking):
        search_again(search, ranking)
    search_optimised(search, ranking, LAST_POLICY)


def search_from_nominal(search: PlanningSearch) -> None:
    """Optimises from the motions that a search without the release window certifies, until one is certified with it.

    The optimiser can fail from Ruckig's motions and come to an answer from one that hits the target already. Where it
    fails from there, too, the refusal can offer the same release without the window.

    Args:
        search: with a window and without an incumbent; updated in place.
    """
    begun_s = time.perf_counter()
    problem = replace(search.problem, release_window_s=0.0)
    inner = PlanningSearch(problem, search.deadline_s)
    try:
        search_thoroughly(inner, candidates(problem))
    except Infeasible:
        return
    search.iterations += inner.iterations
    search.extend_deadline(inner.loading_s)
    found = inner.by_rank()
    search.log_attempt("casadi", f"without the release window: {counted(len(found), 'motion')} certified", begun_s)
    if found:
        known = search.nominal
        best = certified(found[0].backend, search.problem, found[0].solution)
        search.consider(best)
        search.nominal = known or best  # what is known may have a window of its own
        motions = [each.solution.trajectory for each in found]
        releases = [released(motion, "motion without the window") for motion in motions]
        search_optimised(search, Ranking(search.problem, releases, motions), FROM_NOMINAL_POLICY)


def is_doubtful(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether a search may have missed a sooner motion: it certified none, or a slow one, or gave up a seed.

    A seed that was given up is no sign of it where the joints are free and the answer is near the least bound, nor of a
    throw to a target with a release window: of 24 repeats for that alone none found a sooner one. So it counts for
    given release states, for points with a release window, which are never slow, and for quick throws to a target,
    whose time for the jerk hides that they are.
    """
    if search.is_optimal or search.out_of_time or (_is_optimised(search) and not search.in_vain):
        return False
    thrown_in_window = search.problem.is_robust and isinstance(search.problem.release, TargetRelease)
    missed = search.given_up > 0 and not thrown_in_window and ranking.leaves_much_to_gain(search.release_time_s)
    return missed or _is_slow(search, ranking)


def _is_optimised(search: PlanningSearch) -> bool:
    """Returns whether a search has an answer, and the optimiser came to a motion.

    Repeats are shorter then, and begin from those candidates alone that led to no motion. Of 512 other seeds five gave
    something sooner, of 168 whose candidate had led to none at least once 14; of given releases none of 28, and five
    of 26.
    """
    return search.incumbent is not None and search.has_optimised


def _is_slow(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether a search certified no motion, or a slow one: a better sign than a seed that was given up."""
    return search.incumbent is None or ranking.is_slow(search.release_time_s)


def search_again(search: PlanningSearch, ranking: Ranking) -> None:
    """Repeats a search in the ways of `_ways`: under tighter limits, and with torque held from the beginning.

    What is sooner becomes the incumbent. Each of these ways begins with its first seeds; further ones follow where
    there is no answer yet, and while that with a release window is slow. Without a window they gave something sooner in
    10 of 877 cases.

    Args:
        search: updated in place.
        ranking: of its problem's candidates.
    """
    begun_s = time.perf_counter()
    problem = search.problem
    ways = _ways(search)
    gained = [way.name for way in ways if _gains(search, way.ranking, FIRST_AGAIN_POLICY, way.held)]
    if search.incumbent is None or (problem.is_robust and _is_slow(search, ranking)):
        gained += [way.name for way in ways if _gains(search, way.ranking, AGAIN_POLICY, way.held)]
    result = f"sooner {', then '.join(gained)}" if gained else "nothing sooner"
    search.log_attempt("casadi", f"once more, under tighter limits: {result}", begun_s)


def _ways(search: PlanningSearch) -> list[_Way]:
    """Returns the ways in which a search is repeated, in their order.

    Where something was optimised the jerk is halved twice for a target, or else once. In 10,000 requests that gave 81
    sooner motions in 502 repeats, less jerk than that 7 in 346, and torque held 5 in 125.
    """
    problem, halvings = search.problem, _halvings(search.problem.limits)
    if _is_optimised(search):
        count = FEW_HALVINGS_TO_TARGET if isinstance(problem.release, TargetRelease) else FEW_HALVINGS
        return [_tighter_way(problem, *times, tuple(search.in_vain)) for times in halvings[:count]]
    with_torque = [] if problem.fixes_joints else [_Way("with torque held", problem, TORQUE)]
    return [*with_torque, *(_tighter_way(problem, *times) for times in halvings)]


def _tighter_way(
    problem: ThrowProblem, jerk: int, acceleration: int, begun: tuple[Candidate, ...] | None = None
) -> _Way:
    tighter = replace(problem, limits=_halved(problem.limits, jerk, acceleration))
    return _Way(f"with jerk / {2**jerk}, acceleration / {2**acceleration}", tighter, begun=begun)


def search_slower(search: PlanningSearch, found: list[Candidate]) -> None:
    """Takes the soonest of Ruckig's motions to a given release state under tighter limits, where it is an improvement.

    They are other curves between the same states, so one of them may be clear of what the soonest one meets. A request
    with four times the jerk, or twice the acceleration, tries half of this one's, too.

    Args:
        search: updated in place.
        found: candidates of its problem.
    """
    _take_slower(search, found, SLOWER_HALVINGS, SLOWER_POLICY, "slower arrivals")


def search_sooner(search: PlanningSearch, found: list[Candidate]) -> None:
    """Takes Ruckig's other motions to a given release state under tighter limits, where they are an improvement.

    After the optimiser there are few that release before its motion.

    Args:
        search: with an incumbent; updated in place.
        found: candidates of its problem.
    """
    _take_slower(search, found, SOONER_HALVINGS, SOONER_POLICY, "slower motions")


def _take_slower(
    search: PlanningSearch,
    found: list[Candidate],
    halvings: Iterable[tuple[int, int]],
    policy: Sequence[Stage],
    what: str,
) -> None:
    """Takes Ruckig's motions with jerk and acceleration halved so many times, where one is an improvement."""
    limits = search.problem.limits
    problems = [replace(search.problem, limits=_halved(limits, *times)) for times in halvings]
    begun_s = time.perf_counter()
    gained = [_gains(search, Ranking(each, found), policy) for each in problems]
    if any(gained):
        search.log_attempt("ruckig", f"{what}: a sooner motion", begun_s)


def _halvings(limits: Limits) -> list[tuple[int, int]]:
    """Returns how many times jerk and acceleration are halved [-], in the order in which they are tried.

    Of 263 repeated searches half of the jerk gave something sooner in 30, a quarter in 17, less in 8, half of the
    acceleration in 3, and half of both in none.
    """
    longest_s = float((limits.qdd_max / limits.jerk_max).max())  # of one slow joint, say: it decides the launch
    count = int(np.clip(np.ceil(np.log2(RAMP_S / max(longest_s, TINY_S))), HALVINGS_MIN, HALVINGS_MAX))
    return [*((times, 0) for times in range(1, count + 1)), (0, 1)]


def _halved(limits: Limits, jerk: int, acceleration: int) -> Limits:
    """Returns limits with jerk and acceleration halved so many times."""
    return replace(limits, jerk_max=0.5**jerk * limits.jerk_max, qdd_max=0.5**acceleration * limits.qdd_max)


@dataclass(frozen=True, eq=False)
class _Way:
    """A way in which a search is repeated.

    Attributes:
        name: for the attempt log.
        problem: with the limits of this way.
        held: groups of rows that the optimiser's first solves include.
        begun: candidates that it begins from; None for all within its limits.
    """

    name: str
    problem: ThrowProblem
    held: frozenset[str] = frozenset()
    begun: tuple[Candidate, ...] | None = None

    @cached_property
    def ranking(self) -> Ranking | None:
        """The candidates of this way, None without any; it notes what was tried."""
        if self.begun is not None:
            return Ranking(self.problem, self.begun)
        try:
            return Ranking(self.problem, candidates(self.problem))
        except Infeasible:
            return None


def _gains(
    search: PlanningSearch,
    ranking: Ranking | None,
    policy: Sequence[Stage],
    held: frozenset[str] = frozenset(),
) -> bool:
    """Returns whether a motion of another search is sooner than the incumbent, and takes it.

    Args:
        search: updated in place.
        ranking: of candidates for the search's own problem, or that with tighter limits; None for no candidates.
        policy: what is tried.
        held: groups of rows that the optimiser's first solves include.
    """
    if ranking is None or search.out_of_time or search.is_optimal:
        return False
    inner = search.continued(ranking.problem, held)
    before_s = search.release_time_s
    search_optimised(inner, ranking, policy)
    search.iterations += inner.iterations
    search.extend_deadline(inner.loading_s)
    for motion in inner.certified:
        search.consider(certified(motion.backend, search.problem, motion.solution))
    return search.release_time_s < before_s
