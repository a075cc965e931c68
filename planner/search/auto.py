"""How the optimiser is used: a few seeds, warm-started from Ruckig; `auto` also keeps what Ruckig does sooner.

Where the release state is given and nothing couples the joints, Ruckig's motion with free acceleration at the release
is as soon as the slowest joint alone: then there is nothing left to optimise.

Counts decide what is tried, so that the same request has the same answer; clocks only cut off: the deadline, a hard
seed's patience, and the second after which no further seed is begun.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import Guess
from planner.certificate import Certificate
from planner.errors import SolverFailed
from planner.geometry import body_model
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.search.incumbent import Search
from planner.seeds.candidates import Candidate

MOST_SEEDS = {JointRelease: 1, PoseRelease: 4, PointRelease: 5, TargetRelease: 5}  # tried while there is no answer
SEEDS_FIRST = 2  # tried before Ruckig's own motions are looked at, the second where the first fails
SEEDS_ANSWERED = 3  # tried in all where Ruckig has an answer and the optimiser has none
RUCKIG_FIRST = 6  # seeds whose motions by Ruckig are looked at before more seeds are optimised
RUCKIG_LAST = 11  # of the seeds likewise while there is no answer at all: a refusal shall not take long
BOUND_FIRST = 2  # seeds whose soonest arrivals are tried before anything is optimised
LOOKED_AT = 24  # candidates of least bound; the others lie turns away
TIMED = 8  # of these are sorted by their launch by Ruckig
GIVE_UP_S = 0.75  # [s] after which nothing further is begun without an answer: a refusal shall not take long
LAST_SEED_S = 0.1  # [s] later, the seed that was begun last is given up, too
SEED_S = 0.4  # [s] for a seed: what its solutions take when each of them is a hard one
STUBBORN_S = 0.6  # [s] for the soonest seed once more, where the slow second solver is asked too
STUBBORN_BEFORE_S = 0.6  # [s] spent: later it is not asked
TICK_SLACK = 1e-6  # [-] of a tick, for rounding
SLOW = 0.7  # [-] of the least bound of a target's candidates: nine in ten optimised throws release before
SLOW_ROBUST = 0.85  # [-] likewise with a release window
WAY = np.linspace(0.15, 0.9, 6)  # shares of the straight way to a candidate that are looked at
DEEP_M = 0.02  # [m] that something may be in the way: the optimiser goes round it
OPTIMISED = "optimised"
ROUNDS = 4  # solutions of one seed, each keeping away from what the certificate found in the one before


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate for the release of a problem."""

    problem: ThrowProblem
    candidate: Candidate
    tried: set[str] = field(default_factory=set)  # of Ruckig's launches, and whether it was optimised

    @cached_property
    def arrival_s(self) -> float:
        """When the slowest joint alone can be there, with free acceleration [s]; infinite where Ruckig refuses."""
        arrival = ruckig_otg.arrival(self.problem, self.candidate)
        return float("inf") if arrival is None else arrival.time_s

    @cached_property
    def ruckig_s(self) -> float:
        """How soon Ruckig releases in it with zero acceleration [s]; infinite where it refuses."""
        return ruckig_otg.launch_time(self.problem, self.candidate)


def optimised(search: Search, seeds: list[Seed], with_ruckig: bool) -> None:
    """Optimises from the soonest seed that leads to an answer, and certifies those Ruckig motions that are sooner.

    Args:
        search: to be filled in.
        seeds: soonest first.
        with_ruckig: whether Ruckig's own motions count as answers.
    """
    if with_ruckig and _as_soon_as_one_joint(search, seeds):
        return
    most = MOST_SEEDS[type(search.problem.release)]
    by_optimiser = _first_answer(search, seeds[:SEEDS_FIRST], SEED_S, stubborn=False)
    release = search.problem.release
    if by_optimiser and isinstance(release, TargetRelease) and release.release_position is None:
        _while_slow(search, seeds[:most])
    if with_ruckig:
        _sooner_by_ruckig(search, seeds if by_optimiser else seeds[:RUCKIG_FIRST])
    if not by_optimiser:
        further = seeds[SEEDS_FIRST : most if search.best is None else SEEDS_ANSWERED]
        _first_answer(search, further, SEED_S, stubborn=False)
        if with_ruckig:
            _sooner_by_ruckig(search, seeds[RUCKIG_FIRST:] if search.best else seeds[RUCKIG_FIRST:RUCKIG_LAST])
    if search.best is None and search.spent_s < STUBBORN_BEFORE_S:
        _first_answer(search, seeds[:1], STUBBORN_S, stubborn=True)


def _as_soon_as_one_joint(search: Search, seeds: list[Seed]) -> bool:
    """Tries Ruckig's soonest motions to a given release state; returns whether one is certified that nothing beats."""
    problem = search.problem
    if not isinstance(problem.release, JointRelease | PoseRelease) or problem.is_robust:
        return False
    begun, tried = time.perf_counter(), 0
    soonest = sorted(seeds[:TIMED], key=lambda seed: seed.arrival_s)[:BOUND_FIRST]
    for seed in soonest:
        if seed.arrival_s >= search.release_time_s:
            break
        tried += _try_launch(search, seed, "free") is not None
    bound_s = problem.dt * math.ceil(soonest[0].arrival_s / problem.dt - TICK_SLACK)
    done = search.release_time_s <= bound_s + TICK_SLACK * problem.dt
    valid = "certified, as soon as the slowest joint alone" if done else f"{int(search.best is not None)} certified"
    search.tell("ruckig", f"{tried} motions with free acceleration at the release; {valid}", begun)
    return done


def _first_answer(search: Search, seeds: list[Seed], patience_s: float, stubborn: bool) -> bool:
    """Optimises from seed after seed until one is certified; returns whether one was."""
    begun, solved, valid, failure = time.perf_counter(), 0, 0, ""
    for seed in seeds:
        if valid or search.left_s <= 0.0 or search.spent_s > GIVE_UP_S:
            break
        if seed.candidate.bound_s >= search.release_time_s:
            continue
        try:
            valid += _optimise(search, seed, patience_s, stubborn)
            solved += 1
        except SolverFailed as error:
            failure = str(error)
    result = f"{valid} of {solved} motions certified" + (f"; {failure}" if failure else "")
    search.tell("casadi", result, begun)
    return valid > 0


def _while_slow(search: Search, seeds: list[Seed]) -> None:
    """Optimises from further seeds while the best throw is a slow one beside what candidates could do as they are.

    An optimised throw leaves its candidate far behind; one that hardly did has got stuck in a poor way to throw.
    """
    begun, solved, valid = time.perf_counter(), 0, 0
    enough_s = (SLOW_ROBUST if search.problem.is_robust else SLOW) * min(seed.candidate.bound_s for seed in seeds)
    for seed in (seed for seed in seeds if OPTIMISED not in seed.tried):
        if search.release_time_s <= enough_s or search.left_s <= 0.0 or search.spent_s > GIVE_UP_S:
            break
        solved += 1
        try:
            valid += _optimise(search, seed, SEED_S)
        except SolverFailed:
            continue
    if solved:
        search.tell("casadi", f"the throw was slow; {valid} of {solved} motions from further seeds certified", begun)


def _sooner_by_ruckig(search: Search, seeds: list[Seed]) -> None:
    """Certifies those Ruckig motions that would release sooner than the best answer, soonest first."""
    begun, tried, valid = time.perf_counter(), 0, 0
    for seed in seeds:
        if search.left_s <= 0.0 or (search.best is None and search.spent_s > GIVE_UP_S):
            break
        if seed.candidate.bound_s >= search.release_time_s or seed.arrival_s >= search.release_time_s:
            continue
        for launch in ruckig_otg.LAUNCHES:
            if launch == ruckig_otg.SPARE and search.best is not None:
                continue
            certificate = _try_launch(search, seed, launch)
            if certificate is not None:
                tried += 1
                valid += certificate.valid
    search.tell("ruckig", f"{valid} of {tried} motions certified that would release sooner", begun)


def _try_launch(search: Search, seed: Seed, launch: str) -> Certificate | None:
    """Certifies a motion by Ruckig; None where it was tried before, is not sooner than the best, or does not exist."""
    if launch in seed.tried or (launch != "free" and seed.ruckig_s >= search.release_time_s):
        return None
    seed.tried.add(launch)
    try:
        solution = ruckig_otg.solve(search.problem, seed.candidate, launch)
    except SolverFailed:
        return None  # a phase that does not fit the tick grid; its launch time alone was known
    if solution.trajectory.release_time_s >= search.release_time_s:
        return None
    return search.judge("ruckig", solution)


def by_launch_time(problem: ThrowProblem, candidates: list[Candidate]) -> list[Seed]:
    """Returns seeds: the first by how soon Ruckig releases in them, those after them by their bound.

    Where the straight way to the soonest is not free, those with a free way come first.
    """
    seeds = [Seed(problem, candidate) for candidate in candidates[:LOOKED_AT]]
    first = sorted(seeds[:TIMED], key=lambda seed: seed.ruckig_s)
    if not all(_ways_are_free(first[:1])):
        first = [first[i] for i in np.argsort(np.logical_not(_ways_are_free(first)), kind="stable")]
    return [*first, *seeds[TIMED:]]


def _ways_are_free(seeds: list[Seed]) -> list[bool]:
    """Returns for every seed of a problem whether nothing stands in the straight way to it, or hardly anything."""
    problem = seeds[0].problem
    ways = problem.start + np.multiply.outer(WAY, np.array([seed.candidate.q for seed in seeds]) - problem.start)
    least = body_model(problem.cell).clearances(ways.reshape(-1, len(problem.start))).least.reshape(len(WAY), -1)
    return (least.min(axis=0) > -DEEP_M).tolist()


def _optimise(search: Search, seed: Seed, patience_s: float, stubborn: bool = False) -> bool:
    """Solves from one seed; again with wider margins where the certificate finds fault. Returns whether valid.

    A motion that comes much too near to something between two looks is solved for afresh on more stages.
    """
    seed.tried.add(OPTIMISED)
    warm_start, margins, fine = _warm_start(seed), casadi_nlp.CLOSE, False
    deadline_s = min(search.deadline_s, time.perf_counter() + patience_s)
    if search.best is None and not stubborn:
        deadline_s = min(deadline_s, search.begun_s + GIVE_UP_S + LAST_SEED_S)
    for _ in range(ROUNDS):
        solution = casadi_nlp.solve(search.problem, seed.candidate, warm_start, deadline_s, margins, fine, stubborn)
        certificate = search.judge("casadi", solution)
        if certificate.valid:
            return True
        if not (fine or search.problem.is_robust) and casadi_nlp.far_off(certificate.failures):
            warm_start, margins, fine = _warm_start(seed), casadi_nlp.CLOSE, True
            continue
        wider = margins.widened(certificate.failures, solution)
        if wider is None:
            return False
        warm_start, margins = solution.trajectory, wider
    return False


def _warm_start(seed: Seed) -> Guess | None:
    return None if seed.ruckig_s == float("inf") else ruckig_otg.rough(seed.problem, seed.candidate)
