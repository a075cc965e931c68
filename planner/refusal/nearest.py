"""A feasible problem near one that was refused. There may be a nearer one: a few lines of relaxation are searched.

A release kind has relaxations (`relaxations`): functions of a share from 0, which is easy, to 1, which is as requested.
The first of them whose easy end has an answer is bisected, for the largest share that has one. An answer is what the
search for a plan finds: a certified motion with a way home. A release window that alone is in the way is bisected
instead of the release; one that not even the easy ends keep is given up, and bisected for the release that is found
without it. A request that only its time limit ended is its own nearest one, with more time. The budget is a number of
searches, and their time that of the request and a little beyond.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from planner.errors import Infeasible, SolverFailed
from planner.problem import ThrowProblem
from planner.refusal.proofs import refuse_impossible
from planner.refusal.relaxations import Relaxation, relaxations
from planner.request import release_document
from planner.search import PlanningSearch, find_way_home, search_candidates
from planner.seeds import candidates

BISECTIONS = 5  # [-] of a share, which is found to 1/32
CANDIDATES = 2  # [-] tried in one search: the first leads to most answers
SEARCHES_MAX = 12  # [-] in all; most refusals take three to six
LATE_SEARCHES_MAX = 6  # [-] in all, once the request's deadline has passed
LATE_S = 2.0  # [s] that a search for an offer may take beyond the request's deadline
WINDOW_GRID_S = 1e-4  # [s] windows are whole steps of it: no gripper is timed more finely
DECIMALS = 4  # [-] of windows in seconds
ROUNDING = 1e-9  # [-] of a number of steps


def nearest_problem(search: PlanningSearch) -> ThrowProblem | None:
    """Returns a problem near it that has a certified motion with a way home; None if none was found.

    Args:
        search: that found no answer.
    """
    problem = search.problem
    answers = _Answers(search)
    if search.out_of_time and answers.has(problem):
        return problem
    if not problem.is_robust:
        return _closest(problem, answers)
    nominal = replace(problem, release_window_s=0.0)
    if answers.has(nominal):
        return _with_largest_window(nominal, problem.release_window_s, answers)
    found = _closest(problem, answers)
    if found is None:
        found = _closest(nominal, answers)
    if found is None or found.is_robust:
        return found
    return _with_largest_window(found, problem.release_window_s, answers)


class _Answers:
    """Which problems have an answer, within the budget of searches and the time that is left.

    Attributes:
        refused: the search without an answer that all of these follow.
        searches: made so far.
        deadline_s: of all of them, on the clock of `time.perf_counter`.
    """

    def __init__(self, refused: PlanningSearch) -> None:
        self.refused = refused
        self.searches = 0
        self.deadline_s = max(refused.deadline_s, time.perf_counter() + LATE_S)

    def has(self, problem: ThrowProblem) -> bool:
        """Returns whether a certified motion with a way home is found; not where budget or time are spent."""
        if self.searches >= (LATE_SEARCHES_MAX if self.refused.out_of_time else SEARCHES_MAX):
            return False
        if time.perf_counter() >= self.deadline_s:
            return False
        try:
            refuse_impossible(problem)
            found = candidates(problem, self.deadline_s)
        except (Infeasible, SolverFailed):
            return False
        self.searches += 1
        search = PlanningSearch(problem, self.deadline_s, is_for_any=True, tell=self.refused.step)
        search_candidates(search, found, CANDIDATES)
        self.refused.extend_deadline(search.loading_s)
        self.deadline_s += search.loading_s
        return search.best is not None and find_way_home(problem, search.best, self.deadline_s)[0] is not None


def _closest(problem: ThrowProblem, answers: _Answers) -> ThrowProblem | None:
    """Returns the problem with the largest share of its first relaxation that has an answer; None without any."""
    for relaxation in relaxations(problem):
        relaxed = partial(_relaxed, problem, relaxation)
        if not answers.has(relaxed(0.0)):
            continue
        whole = relaxed(1.0)
        is_request = release_document(whole.release) == release_document(problem.release)
        return whole if not is_request and answers.has(whole) else _largest(relaxed, answers)
    return None


def _with_largest_window(nominal: ThrowProblem, window_s: float, answers: _Answers) -> ThrowProblem:
    """Returns a problem that has an answer without a release window, with as much of the window as has one."""
    return _largest(partial(_with_window, nominal, window_s), answers)


def _largest(asked: Callable[[float], ThrowProblem], answers: _Answers) -> ThrowProblem:
    """Returns the problem with the largest share that has an answer, found by bisection: 0 has one, 1 has none."""
    answered = 0.0
    refused = 1.0
    for _ in range(BISECTIONS):
        share = (answered + refused) / 2.0
        if answers.has(asked(share)):
            answered = share
        else:
            refused = share
    return asked(answered)


def _relaxed(problem: ThrowProblem, relaxation: Relaxation, share: float) -> ThrowProblem:
    return problem.with_release(relaxation(share))


def _with_window(nominal: ThrowProblem, window_s: float, share: float) -> ThrowProblem:
    """Returns the problem with a share of a release window, in whole steps."""
    steps = math.floor(share * window_s / WINDOW_GRID_S + ROUNDING)
    return replace(nominal, release_window_s=round(steps * WINDOW_GRID_S, DECIMALS))
