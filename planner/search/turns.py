"""The search for a motion that ends with throws, one after another: each throw by itself, from the last.

    the first throw, as if it were the only one; after other passages, from where their motion passes the last of them
      → from where its object is out of the grip, still in motion, the next throw; else from where its brake ends
      → certified as one

So each launch is one of the optimiser, and the motion goes on from throw to throw without a leg between them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile

import numpy as np

from planner.backends import ruckig_otg
from planner.backends.solution import Solution
from planner.errors import InvalidProblem, SolverFailed
from planner.passages import passed_until, released_first
from planner.problem import ThrowProblem
from planner.search.record import CertifiedSolution, PlanningSearch, counted
from planner.search.stops import search_throw
from planner.trajectory import Trajectory, in_a_row

PACES = (1.0, 0.5, 0.25)  # [-] of a leg, tried in turn: torques, tool speed and what is near may ask for a gentler one
LEAVES_S = 0.04  # [s] after the release in which the object leaves the open grip: 1 cm under gravity takes 45 ms
# [-] of the tool speed, in turn: a throw by itself does not know how fast the other grippers are
SPEEDS = (1.0, 0.8, 0.6)
MOTIONS = 2  # [-] of each throw that the next one is planned from


def search_in_turn(search: PlanningSearch, before: CertifiedSolution | None = None) -> None:
    """Searches for a motion of throws, until one is certified; leaves the search without one otherwise.

    Args:
        search: of a chain; updated in place.
        before: a motion through the passages before the throws, to rest; None: there are only throws.
    """
    problem = search.problem
    begun_s = time.perf_counter()
    tried = len(search.certified) + len(search.rejected)
    starts: Sequence[tuple[Trajectory | None, tuple[int, ...]]] = [(None, ())]
    if before is not None:
        whole = before.solution.trajectory
        last = passed_until(problem.passages[: len(whole.passed)], whole)[-1]
        starts = [(whole.until(end), whole.passed) for end in (last, len(whole.q) - 1)]
    for share in SPEEDS:
        for made, passed in starts:
            _go_on(search, share, made, passed)
    tried = len(search.certified) + len(search.rejected) - tried
    result = f"one throw after another: {len(search.certified)} of {counted(tried, 'motion')} certified"
    search.log_attempt("auto", result, begun_s)


def thrown_last(problem: ThrowProblem) -> int:
    """Returns how many passages a chain ends with that are throws of the optimiser, in turn; 0 where none can be."""
    if problem.backend != "auto" or not (problem.end is None or problem.end.joint_state is not None):
        return 0
    return len(list(takewhile(lambda each: each.releases and not each.is_timed, reversed(problem.passages))))


def _go_on(search: PlanningSearch, share: float, made: Trajectory | None, passed: tuple[int, ...]) -> None:
    """Plans the throws that are still to come, at a share of the tool speed, from the end of what is made.

    Whole motions are certified.
    """
    if search.best is not None or search.out_of_time:
        return
    problem = search.problem
    number = len(passed)
    alone = problem.alone(number)
    alone = replace(alone, limits=replace(alone.limits, tcp_speed_max=share * alone.limits.tcp_speed_max))
    if made is not None:
        try:
            alone = replace(alone, start=made.q[-1], start_qd=made.qd[-1], start_qdd=made.qdd[-1])
        except InvalidProblem:
            return
    for throw in _throws(search, alone):
        trajectory = throw.solution.trajectory
        whole = trajectory if made is None else in_a_row(made, trajectory)
        leaves = whole.release_index + math.ceil((alone.opening_spread_s + LEAVES_S) / alone.dt)
        goes_on = [whole.until(end) for end in (leaves, len(whole.q) - 1) if end < len(whole.q)]
        released = (*passed, whole.release_index)
        if number + 1 == len(problem.passages):
            ended = [whole] if problem.end is None else _ended(problem, goes_on)
            _certify(search, throw.backend, ended, released)
            continue
        for until in goes_on:
            _go_on(search, share, until, released)


def _certify(search: PlanningSearch, backend: str, motions: Iterable[Trajectory], released: tuple[int, ...]) -> None:
    """Certifies whole motions that pass their passages at these samples, until one is valid."""
    for motion in motions:
        if search.best is not None:
            return
        search.step(1)
        release_index = released_first(search.problem.passages, released)
        whole = replace(motion, release_index=release_index, passage_indices=released)
        search.certify(backend, Solution(whole, "one throw after another"))


def _throws(search: PlanningSearch, alone: ThrowProblem) -> list[CertifiedSolution]:
    """Returns the motions of a throw by itself, the soonest first."""
    with search.inner(alone) as inner:
        search_throw(inner)
    return inner.by_rank()[:MOTIONS]


def _ended(problem: ThrowProblem, motions: Sequence[Trajectory]) -> Iterator[Trajectory]:
    """Yields the motions with a leg to the end that is asked for, the fastest first."""
    assert problem.end is not None and problem.end.joint_state is not None
    goal = (problem.end.joint_state[0], np.zeros(6), np.zeros(6))
    for motion in motions:
        for pace in PACES:
            with suppress(SolverFailed):
                leg = ruckig_otg.leg(problem, (motion.q[-1], motion.qd[-1], motion.qdd[-1]), goal, pace)
                last = Trajectory(motion.sample_rate_hz, *leg, release_index=0)
                yield replace(in_a_row(motion, last), release_index=motion.release_index)
