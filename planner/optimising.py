"""How the optimiser is used: a few seeds, warm-started from Ruckig; `auto` also keeps what Ruckig does sooner.

Counts decide what is tried, so that the same request has the same answer; clocks only cut off: the deadline, a hard
seed's patience, and the second after which no further seed is begun.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import Guess
from planner.errors import SolverFailed
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.release import Candidate
from planner.search import Search

MOST_SEEDS = {JointRelease: 1, PoseRelease: 4, PointRelease: 5, TargetRelease: 5}  # tried while there is no answer
SEEDS_FIRST = 2  # tried before Ruckig's own motions are looked at, the second where the first fails
SEEDS_ANSWERED = 3  # tried in all where Ruckig has an answer and the optimiser has none
RUCKIG_FIRST = 6  # seeds whose motions by Ruckig are looked at before more seeds are optimised
RUCKIG_LAST = 14  # of the seeds likewise while there is no answer at all: a refusal shall not take long
LOOKED_AT = 24  # candidates of least bound; the others lie turns away
TIMED = 8  # of these are sorted by their launch by Ruckig
GIVE_UP_S = 1.0  # [s] after which no further seed is begun: a refusal shall not take long
SEED_S = 0.4  # [s] for a seed: what its solutions take when each of them is a hard one
STUBBORN_S = 0.6  # [s] for the soonest seed once more, where the slow second solver is asked too
ROUNDS = 4  # solutions of one seed, each keeping away from what the certificate found in the one before


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate for the release of a problem."""

    problem: ThrowProblem
    candidate: Candidate

    @cached_property
    def ruckig_s(self) -> float:
        """How soon Ruckig releases in it [s]; infinite where it refuses."""
        return ruckig_otg.launch_time(self.problem, self.candidate)


def optimised(search: Search, seeds: list[Seed], with_ruckig: bool) -> None:
    """Optimises from the soonest seed that leads to an answer, and certifies those Ruckig motions that are sooner.

    Args:
        search: to be filled in.
        seeds: soonest first.
        with_ruckig: whether Ruckig's own motions count as answers.
    """
    most = MOST_SEEDS[type(search.problem.release)]
    by_optimiser = _first_answer(search, seeds[:SEEDS_FIRST], SEED_S, stubborn=False)
    if with_ruckig:
        _sooner_by_ruckig(search, seeds if by_optimiser else seeds[:RUCKIG_FIRST])
    if not by_optimiser:
        further = seeds[SEEDS_FIRST : most if search.best is None else SEEDS_ANSWERED]
        _first_answer(search, further, SEED_S, stubborn=False)
        if with_ruckig:
            _sooner_by_ruckig(search, seeds[RUCKIG_FIRST:] if search.best else seeds[RUCKIG_FIRST:RUCKIG_LAST])
    if search.best is None:
        _first_answer(search, seeds[:1], STUBBORN_S, stubborn=True)


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


def _sooner_by_ruckig(search: Search, seeds: list[Seed]) -> None:
    """Certifies those Ruckig motions that would release sooner than the best answer, soonest first."""
    begun, tried, valid = time.perf_counter(), 0, 0
    for seed in seeds:
        if search.left_s <= 0.0:
            break
        if seed.candidate.bound_s >= search.release_time_s or seed.ruckig_s >= search.release_time_s:
            continue
        for launch in ruckig_otg.LAUNCHES:
            if launch == ruckig_otg.SPARE and search.best is not None:
                continue
            try:
                solution = ruckig_otg.solve(search.problem, seed.candidate, launch)
            except SolverFailed:
                continue  # a phase that does not fit the tick grid; its launch time alone was known
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.judge("ruckig", solution).valid
    search.tell("ruckig", f"{valid} of {tried} motions certified that would release sooner", begun)


def by_launch_time(problem: ThrowProblem, candidates: list[Candidate]) -> list[Seed]:
    """Returns seeds: the first by how soon Ruckig releases in them, those after them by their bound."""
    seeds = [Seed(problem, candidate) for candidate in candidates[:LOOKED_AT]]
    return [*sorted(seeds[:TIMED], key=lambda seed: seed.ruckig_s), *seeds[TIMED:]]


def _optimise(search: Search, seed: Seed, patience_s: float, stubborn: bool = False) -> bool:
    """Solves from one seed; again with wider margins where the certificate finds fault. Returns whether valid."""
    warm_start, margins = _warm_start(seed), casadi_nlp.CLOSE
    deadline_s = min(search.deadline_s, time.perf_counter() + patience_s)
    for _ in range(ROUNDS):
        solution = casadi_nlp.solve(search.problem, seed.candidate, warm_start, deadline_s, margins, stubborn)
        certificate = search.judge("casadi", solution)
        if certificate.valid:
            return True
        wider = margins.widened(certificate.failures, solution)
        if wider is None:
            return False
        warm_start, margins = solution.trajectory, wider
    return False


def _warm_start(seed: Seed) -> Guess | None:
    return None if seed.ruckig_s == float("inf") else ruckig_otg.rough(seed.problem, seed.candidate)
