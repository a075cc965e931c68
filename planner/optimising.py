"""How the optimiser is used: a few seeds, warm-started from Ruckig; `auto` also keeps what Ruckig does sooner.

Counts, not clocks, decide what is tried, so that the same request has the same answer; the deadline only cuts off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from planner.backends import casadi_nlp, ruckig_otg
from planner.certificate import Certificate
from planner.errors import SolverFailed
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.release import Candidate
from planner.search import Search
from planner.solution import Solution
from planner.trajectory import Trajectory

# Seeds optimised once an answer is known, and at most while none is.  # source: measured, docs/benchmarks
SEEDS = {JointRelease: (1, 1), PoseRelease: (1, 6), PointRelease: (1, 8), TargetRelease: (1, 8)}
TIMED = 24  # candidates of least bound whose launch by Ruckig is timed; the others lie turns away
SECOND_TRY_S = 0.12  # [s] for a further seed once an answer is known: too little for the slow second solver to begin
WORTH = 0.995  # [-] a further seed must be able to release this much sooner than the best answer


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate and how soon Ruckig releases in it [s]; infinite where Ruckig refuses."""

    candidate: Candidate
    ruckig_s: float


def optimised(search: Search, seeds: list[Seed]) -> None:
    """Improves on the best answer by optimal control, over a few seeds."""
    begun, solved, valid, failure = time.perf_counter(), 0, 0, ""
    enough, most = SEEDS[type(search.problem.release)]
    for number, seed in enumerate(seeds[:most]):
        if (number >= enough and search.best is not None) or search.left_s <= 0.0:
            break
        if seed.candidate.bound_s >= WORTH * search.release_time_s:
            continue
        try:
            valid += _optimise(search, seed)
            solved += 1
        except SolverFailed as error:
            failure = str(error)
    result = f"{valid} of {solved} motions certified" + (f"; {failure}" if failure else "")
    search.tell("casadi", result, begun)


def sooner_by_ruckig(search: Search, seeds: list[Seed]) -> None:
    """Certifies those Ruckig motions that would release sooner than the best answer, soonest first."""
    begun, tried, valid = time.perf_counter(), 0, 0
    for seed in seeds:
        if seed.ruckig_s >= search.release_time_s or search.left_s <= 0.0:
            break
        for launch in ruckig_otg.LAUNCHES:
            solution = ruckig_otg.solve(search.problem, seed.candidate, launch)
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.judge("ruckig", solution).valid
    search.tell("ruckig", f"{valid} of {tried} motions certified that would release sooner", begun)


def by_launch_time(problem: ThrowProblem, seeds: list[Candidate]) -> list[Seed]:
    """Returns the soonest seeds by how soon Ruckig releases in them; those it refuses come last."""
    timed = [Seed(seed, ruckig_otg.launch_time(problem, seed)) for seed in seeds[:TIMED]]
    return sorted(timed, key=lambda seed: seed.ruckig_s)


def _optimise(search: Search, seed: Seed) -> bool:
    """Solves from one seed; once more with wide margins where the certificate finds fault. Returns whether valid."""
    warm_start = _warm_start(search.problem, seed)
    certificate = _solve_and_judge(search, seed, warm_start, wide=False)
    if certificate.valid:
        return True
    return _solve_and_judge(search, seed, warm_start, wide=True).valid


def _solve_and_judge(search: Search, seed: Seed, warm_start: Trajectory | None, wide: bool) -> Certificate:
    problem = search.problem
    deadline_s = search.deadline_s
    if search.best is not None:
        deadline_s = min(deadline_s, time.perf_counter() + SECOND_TRY_S)
    solution: Solution = casadi_nlp.solve(problem, seed.candidate, warm_start, deadline_s, wide)
    return search.judge("casadi", solution)


def _warm_start(problem: ThrowProblem, seed: Seed) -> Trajectory | None:
    if seed.ruckig_s == float("inf"):
        return None
    return ruckig_otg.solve(problem, seed.candidate).trajectory
