"""How the optimiser is used: a few seeds, warm-started from Ruckig; `auto` also keeps what Ruckig does sooner.

Counts, not clocks, decide what is tried, so that the same request has the same answer; the deadline only cuts off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from planner.backends import casadi_nlp, ruckig_otg
from planner.errors import SolverFailed
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.release import Candidate
from planner.search import Search
from planner.trajectory import Trajectory

MOST_SEEDS = {JointRelease: 1, PoseRelease: 6, PointRelease: 8, TargetRelease: 8}  # tried while there is no answer
TIMED = 24  # candidates of least bound whose launch by Ruckig is timed; the others lie turns away
FIRST_TRY_S = 0.6  # [s] for the first seed, a second solver included, before Ruckig's own motions are looked at
SECOND_TRY_S = 0.12  # [s] for a further seed once there is an answer: too little for the slow second solver to begin
FURTHER_TRY_S = 1.5  # [s] for a further seed while there is none
WORTH = 0.995  # [-] a further seed must be able to release this much sooner than the best answer


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate and how soon Ruckig releases in it [s]; infinite where Ruckig refuses."""

    candidate: Candidate
    ruckig_s: float


def optimised(search: Search, seeds: list[Seed], with_ruckig: bool) -> None:
    """Optimises from the soonest seed, certifies Ruckig's sooner motions, goes on to further seeds while there is none.

    Args:
        search: to be filled in.
        seeds: soonest first.
        with_ruckig: whether Ruckig's own motions count as answers.
    """
    _optimise_some(search, seeds[:1], FIRST_TRY_S)
    by_optimiser = search.best is not None
    if with_ruckig:
        _sooner_by_ruckig(search, seeds)
    if not by_optimiser:
        answered = search.best is not None
        most = 2 if answered else MOST_SEEDS[type(search.problem.release)]
        _optimise_some(search, seeds[1:most], SECOND_TRY_S if answered else FURTHER_TRY_S)


def _optimise_some(search: Search, seeds: list[Seed], patience_s: float) -> None:
    """Optimises from seed after seed until one is certified."""
    begun, solved, valid, failure = time.perf_counter(), 0, 0, ""
    for seed in seeds:
        if valid or search.left_s <= 0.0:
            break
        if seed.candidate.bound_s >= WORTH * search.release_time_s:
            continue
        try:
            valid += _optimise(search, seed, patience_s)
            solved += 1
        except SolverFailed as error:
            failure = str(error)
    result = f"{valid} of {solved} motions certified" + (f"; {failure}" if failure else "")
    search.tell("casadi", result, begun)


def _sooner_by_ruckig(search: Search, seeds: list[Seed]) -> None:
    """Certifies those Ruckig motions that would release sooner than the best answer, soonest first."""
    begun, tried, valid = time.perf_counter(), 0, 0
    for seed in seeds:
        if seed.ruckig_s >= search.release_time_s or search.left_s <= 0.0:
            break
        for launch in ruckig_otg.LAUNCHES:
            try:
                solution = ruckig_otg.solve(search.problem, seed.candidate, launch)
            except SolverFailed:
                continue  # a phase that does not fit the tick grid; its launch time alone was known
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.judge("ruckig", solution).valid
    search.tell("ruckig", f"{valid} of {tried} motions certified that would release sooner", begun)


def by_launch_time(problem: ThrowProblem, seeds: list[Candidate]) -> list[Seed]:
    """Returns the soonest seeds by how soon Ruckig releases in them; those it refuses come last."""
    timed = [Seed(seed, ruckig_otg.launch_time(problem, seed)) for seed in seeds[:TIMED]]
    return sorted(timed, key=lambda seed: seed.ruckig_s)


def _optimise(search: Search, seed: Seed, patience_s: float) -> bool:
    """Solves from one seed; once more with wide margins where the certificate finds fault. Returns whether valid."""
    warm_start = _warm_start(search.problem, seed)
    deadline_s = min(search.deadline_s, time.perf_counter() + patience_s)
    for wide in (False, True):
        solution = casadi_nlp.solve(search.problem, seed.candidate, warm_start, deadline_s, wide)
        if search.judge("casadi", solution).valid:
            return True
    return False


def _warm_start(problem: ThrowProblem, seed: Seed) -> Trajectory | None:
    if seed.ruckig_s == float("inf"):
        return None
    return ruckig_otg.solve(problem, seed.candidate).trajectory
