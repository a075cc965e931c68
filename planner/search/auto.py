"""The search of `auto` and `casadi`: a table of stages, walked in order.

Ruckig gives the soonest motion to a candidate within the joints' own limits, in microseconds, but disregards everything
that couples the joints; the certificate decides. The optimiser regards every limit and moves the release where the
request leaves it free; it starts from Ruckig's motion. Counts alone decide what is tried, so that the same request has
the same answer; the only clock is the request's own deadline.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from planner.backends import casadi_nlp, ruckig_otg
from planner.certificate import Check
from planner.errors import SolverFailed
from planner.geometry.body import clearances
from planner.problem import JointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.search.incumbent import PlanningSearch
from planner.seeds import Candidate, Seed
from planner.solution import Solution

RANKED_MAX = 24  # candidates of least lower bound that are considered; a pose's others are full turns away
TIMED_MAX = 8  # of these are ranked by Ruckig's launch time
PATH_SHARES = np.linspace(0.15, 0.9, 6)  # [-] of the straight joint path to a candidate, checked for obstacles
OBSTACLE_DEPTH_M = 0.02  # [m] penetration on that path which the optimiser still gets around
SEEDS_MAX = 5  # candidates that are optimised
SLOW = 0.7  # [-] release time over the candidates' least lower bound; nine of ten optimised throws release before
SLOW_ROBUST = 0.85  # [-] the same with a release window
ROUNDS_MAX = 4  # solves from one seed, each after the failed checks of the one before
TICK_SLACK = 1e-6  # [ticks] for rounding


@dataclass(frozen=True, eq=False)
class RankedCandidate:
    """A candidate with Ruckig's times to it and a note of what was tried from it."""

    problem: ThrowProblem
    candidate: Candidate
    tried: set[str] = field(default_factory=set)

    @cached_property
    def arrival_s(self) -> float:
        """Least time of the slowest joint alone, with free acceleration at the release [s]; infinite if refused."""
        arrival = ruckig_otg.arrival(self.problem, self.candidate)
        return float("inf") if arrival is None else arrival.time_s

    @cached_property
    def launch_s(self) -> float:
        """Ruckig's launch time with zero acceleration at the release [s]; infinite if refused."""
        return ruckig_otg.launch_time(self.problem, self.candidate)

    @cached_property
    def seed(self) -> Seed:
        """The optimiser's seed: Ruckig's motion to the candidate, if there is one."""
        refused = self.launch_s == float("inf")
        return Seed(self.candidate, None if refused else ruckig_otg.initial_guess(self.problem, self.candidate))

    def bound_s(self, variant: ruckig_otg.LaunchVariant) -> float:
        """Lower bound on the release time of Ruckig's motion to the candidate [s]."""
        return self.arrival_s if variant == "free" else max(self.arrival_s, self.launch_s)

    def first_try(self, what: str) -> bool:
        """Returns whether this was not tried from the candidate before, and notes that it is now."""
        untried = what not in self.tried
        self.tried.add(what)
        return untried


@dataclass(frozen=True)
class SolveOptions:
    """Adapter: casadi_nlp.SolveOptions once it is there."""

    margins: casadi_nlp.Margins = casadi_nlp.CLOSE
    resolution: Literal["coarse", "fine"] = "coarse"
    iteration_budget: int = 1000
    deadline_s: float | None = None


def _casadi_solve(problem: ThrowProblem, seed: Seed, options: SolveOptions) -> Solution:
    """Adapter: casadi_nlp.solve(problem, seed, options) once it is there."""
    if options.iteration_budget <= 0:
        raise SolverFailed("out of iterations")
    deadline_s = math.inf if options.deadline_s is None else options.deadline_s
    fine = options.resolution == "fine"
    return casadi_nlp.solve(problem, seed.candidate, seed.initial_guess, deadline_s, options.margins, fine)


Ranking = Sequence[RankedCandidate]
Condition = Callable[[PlanningSearch, Ranking], bool]


def always(search: PlanningSearch, ranking: Ranking) -> bool:
    """Holds in every case."""
    return True


def joints_decoupled(search: PlanningSearch, ranking: Ranking) -> bool:
    """Whether the release state is given for a single instant: the slowest joint alone bounds the release time."""
    return isinstance(search.problem.release, JointRelease | PoseRelease) and not search.problem.is_robust


def no_incumbent(search: PlanningSearch, ranking: Ranking) -> bool:
    """Whether there is no certified motion yet."""
    return search.incumbent is None


def has_incumbent(search: PlanningSearch, ranking: Ranking) -> bool:
    """Whether there is a certified motion."""
    return search.incumbent is not None


def none_optimised(search: PlanningSearch, ranking: Ranking) -> bool:
    """Whether no optimised motion is certified yet."""
    return not search.has_certified("casadi")


def throw_is_slow(search: PlanningSearch, ranking: Ranking) -> bool:
    """Whether a throw at a target hardly improves on the candidates: the optimiser is stuck in a poor local minimum."""
    release = search.problem.release
    if none_optimised(search, ranking) or not isinstance(release, TargetRelease):
        return False
    share = SLOW_ROBUST if search.problem.is_robust else SLOW
    least_s = min(ranked.candidate.bound_s for ranked in ranking[:SEEDS_MAX])
    return release.release_position is None and search.release_time_s > share * least_s


@dataclass(frozen=True)
class Stage:
    """One row of the search policy: a back end tries candidates in order while a condition holds.

    Attributes:
        backend: "ruckig" certifies its motions to the candidates, "casadi" optimises from them.
        purpose: what the stage is for, in the attempt log.
        candidates: rows of the ranking; what was tried from one of them before is not tried again.
        condition: checked before every candidate.
        iterations: solver iterations, after which the stage ends ("casadi").
        variants: launch variants that are tried ("ruckig").
        order: of the ranking: as it is, or the `TIMED_MAX` first by their arrival.
    """

    backend: Literal["casadi", "ruckig"]
    purpose: str
    candidates: slice
    condition: Condition
    iterations: int = 0
    variants: Sequence[ruckig_otg.LaunchVariant] = ruckig_otg.VARIANTS
    order: Literal["rank", "arrival"] = "rank"


# An iteration takes 2 to 4 ms. Of 1000 random requests, larger budgets answer one more, and take longer to refuse.
POLICY: tuple[Stage, ...] = (
    Stage("ruckig", "soonest arrivals", slice(0, 2), joints_decoupled, variants=("free",), order="arrival"),
    Stage("casadi", "soonest seeds", slice(0, 2), none_optimised, iterations=300),
    Stage("casadi", "further seeds for a slow throw", slice(0, SEEDS_MAX), throw_is_slow, iterations=300),
    Stage("ruckig", "sooner motions", slice(0, 6), always),
    Stage("casadi", "one more seed", slice(2, 3), none_optimised, iterations=200),
    Stage("casadi", "last seeds", slice(3, SEEDS_MAX), no_incumbent, iterations=100),
    Stage("ruckig", "further motions", slice(6, 11), always),
    Stage("ruckig", "sooner motions", slice(11, RANKED_MAX), has_incumbent),
)


def search_optimised(search: PlanningSearch, candidates: list[Candidate], policy: Sequence[Stage] = POLICY) -> None:
    """Walks the stages of a policy; for `casadi` those of the optimiser alone.

    Args:
        search: updated in place.
        candidates: by ascending lower bound on the launch time.
        policy: the stages.
    """
    ranking = rank(search.problem, candidates)
    with_ruckig = search.problem.backend == "auto"
    if with_ruckig and joints_decoupled(search, ranking):
        search.lower_bound_s = _least_release_time(ranking)
    for stage in policy:
        if stage.backend == "casadi":
            _optimise(search, stage, ranking)
        elif with_ruckig:
            _certify_ruckig(search, stage, ranking)
        if search.is_optimal or search.out_of_time:
            break


def rank(problem: ThrowProblem, candidates: list[Candidate]) -> list[RankedCandidate]:
    """Returns the candidates, the first `TIMED_MAX` by Ruckig's launch time, the others by their lower bound.

    If the straight joint path to the first is obstructed, those with a free path come first.
    """
    ranking = [RankedCandidate(problem, candidate) for candidate in candidates[:RANKED_MAX]]
    first = sorted(ranking[:TIMED_MAX], key=lambda ranked: ranked.launch_s)
    if not all(_paths_free(first[:1])):
        first = [first[i] for i in np.argsort(np.logical_not(_paths_free(first)), kind="stable")]
    return [*first, *ranking[TIMED_MAX:]]


def _paths_free(ranking: Ranking) -> list[bool]:
    """Returns for every candidate whether its straight joint path is free, up to `OBSTACLE_DEPTH_M`."""
    problem = ranking[0].problem
    steps = np.array([ranked.candidate.q for ranked in ranking]) - problem.start
    q = problem.start + np.multiply.outer(PATH_SHARES, steps)
    least = clearances(problem.cell, q.reshape(-1, len(problem.start))).least.reshape(len(PATH_SHARES), -1)
    return (least.min(axis=0) > -OBSTACLE_DEPTH_M).tolist()


def _least_release_time(ranking: Ranking) -> float:
    """Returns the first tick at which the slowest joint alone can be at a candidate [s], with slack for rounding."""
    dt, arrival_s = ranking[0].problem.dt, min(ranked.arrival_s for ranked in ranking[:TIMED_MAX])
    return dt * (math.ceil(arrival_s / dt - TICK_SLACK) + TICK_SLACK) if math.isfinite(arrival_s) else 0.0


def _walk(search: PlanningSearch, stage: Stage, ranking: Ranking) -> Iterator[RankedCandidate]:
    """Yields the candidates of a stage while its condition holds and its budget lasts."""
    end = search.iterations + stage.iterations
    if stage.order == "arrival":
        ranking = sorted(ranking[:TIMED_MAX], key=lambda ranked: ranked.arrival_s)
    for ranked in ranking[stage.candidates]:
        if search.out_of_time or search.iterations > end or not stage.condition(search, ranking):
            return
        yield ranked


def _certify_ruckig(search: PlanningSearch, stage: Stage, ranking: Ranking) -> None:
    """Certifies Ruckig's motions to the candidates of a stage where they are sooner than the incumbent."""
    begun, tried, valid = time.perf_counter(), 0, 0
    for ranked in _walk(search, stage, ranking):
        for variant in stage.variants:
            solution = _ruckig_motion(search, ranked, variant)
            if solution is not None:
                tried += 1
                valid += search.certify("ruckig", solution).valid
    if tried:
        result = f"{stage.purpose}: {valid} of {tried} motions certified"
        search.log_attempt("ruckig", result + ("; none can be sooner" if search.is_optimal else ""), begun)


def _ruckig_motion(
    search: PlanningSearch, ranked: RankedCandidate, variant: ruckig_otg.LaunchVariant
) -> Solution | None:
    """Returns an untried motion that is sooner than the incumbent; None if there is none."""
    latest_s = search.release_time_s
    if ranked.candidate.bound_s >= latest_s or ranked.bound_s(variant) >= latest_s:
        return None
    if (variant == ruckig_otg.LAST_RESORT and search.incumbent is not None) or not ranked.first_try(variant):
        return None
    try:
        solution = ruckig_otg.solve(search.problem, ranked.candidate, variant)
    except SolverFailed:
        return None  # a phase does not fit the tick grid; only its duration was known
    return solution if solution.trajectory.release_time_s < latest_s else None


def _optimise(search: PlanningSearch, stage: Stage, ranking: Ranking) -> None:
    """Optimises from the candidates of a stage."""
    begun, end = time.perf_counter(), search.iterations + stage.iterations
    tried, solved, valid, failure = 0, 0, 0, ""
    bound_holds = isinstance(search.problem.release, JointRelease | PoseRelease)
    for ranked in _walk(search, stage, ranking):
        if (bound_holds and ranked.candidate.bound_s >= search.release_time_s) or not ranked.first_try("casadi"):
            continue
        tried += 1
        try:
            valid += _optimise_from(search, ranked, end)
            solved += 1
        except SolverFailed as error:
            failure = f"; {error}"
    if tried:
        search.log_attempt("casadi", f"{stage.purpose}: {valid} of {solved} motions certified{failure}", begun)


def _optimise_from(search: PlanningSearch, ranked: RankedCandidate, end: int) -> bool:
    """Optimises from one candidate until `search.iterations` reach `end`; returns whether a motion was certified.

    After failed checks it solves again from that motion, with wider margins; where the checks failed between coarse
    stages, from the start on finer stages.
    """
    seed, options = ranked.seed, SolveOptions(deadline_s=search.deadline_s)
    for _ in range(ROUNDS_MAX):
        solution = _solve(search, seed, replace(options, iteration_budget=end - search.iterations))
        certificate = search.certify("casadi", solution)
        if certificate.valid:
            return True
        if _needs_finer_stages(search.problem, options, certificate.failures):
            seed, options = ranked.seed, SolveOptions(deadline_s=search.deadline_s, resolution="fine")
            continue
        wider = options.margins.widened(certificate.failures, solution)
        if wider is None:
            return False
        seed, options = Seed(ranked.candidate, solution.trajectory), replace(options, margins=wider)
    return False


def _solve(search: PlanningSearch, seed: Seed, options: SolveOptions) -> Solution:
    """Returns the optimiser's motion from a seed; counts the iterations, also those of a failure."""
    try:
        solution = _casadi_solve(search.problem, seed, options)
    except SolverFailed as error:
        search.iterations += error.iterations
        raise
    search.iterations += solution.iterations
    return solution


def _needs_finer_stages(problem: ThrowProblem, options: SolveOptions, failures: Iterable[Check]) -> bool:
    """Returns whether checks failed by so much between coarse stages that wider margins are no remedy."""
    return options.resolution == "coarse" and not problem.is_robust and casadi_nlp.far_off(failures)
