"""The search of `auto` and `casadi`: walks the stages of a policy."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, product

import numpy as np

from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import FlightEdge, SolveOptions
from planner.certificate import Check, flight_obstruction
from planner.errors import SolverFailed
from planner.geometry import tool_state
from planner.problem import TargetRelease, ThrowProblem
from planner.search.incumbent import CertifiedSolution, PlanningSearch, certified, counted
from planner.search.policy import POLICY, Stage, release_state_given
from planner.search.ranking import RankedCandidate, Ranking, released
from planner.seeds import Seed
from planner.solution import Solution
from planner.trajectory import Trajectory

IN_HAND_VARIANTS: tuple[ruckig_otg.LaunchVariant, ...] = ("synchronised", "gentle")
IN_HAND_CANDIDATES = 2  # [-] the soonest ones that Ruckig's motions in hand lead to
# [-] At least for a seed that is begun, and for the remedy of a failed check: what is left of a stage is no reason to
# give up half way.
SOLVE_ITERATIONS = 150
WINDOW_BUDGET = 1.5  # [-] times as many iterations: a solve with a window takes 37 in the mean, one without 22
TICK_SLACK = 1e-6  # [ticks] for rounding
NOT_COMPILED = "the solvers are not compiled: the same answer, later; `fling warm` compiles them"


def search_optimised(search: PlanningSearch, ranking: Ranking, policy: Sequence[Stage] = POLICY) -> None:
    """Walks the stages of a policy; for `casadi` those of the optimiser alone.

    Args:
        search: updated in place.
        ranking: of its problem's candidates; notes what was tried.
        policy: the stages.
    """
    with_ruckig = search.problem.backend == "auto"
    if with_ruckig and release_state_given(search, ranking):
        search.lower_bound_s = _least_release_time(search.problem.dt, ranking)
    for stage in policy:
        if stage.backend == "casadi":
            _optimise(search, stage, ranking)
            if with_ruckig and stage.then_in_hand:
                take_in_hand(search, ranking)
        elif with_ruckig:
            _certify_ruckig(search, stage, ranking)
        if search.is_optimal or search.out_of_time:
            break


def _least_release_time(dt: float, ranking: Ranking) -> float:
    """Returns the first tick at which the slowest joint alone can be at a candidate [s], with slack for rounding.

    Of a release that is reached within the fewest ticks of a motion, as one at the start is, none sooner is sought.
    """
    arrival_s = next(ranking.by_arrival()).arrival_s
    if not math.isfinite(arrival_s):
        return 0.0
    return dt * (max(math.ceil(arrival_s / dt - TICK_SLACK), ruckig_otg.TICKS_MIN) + TICK_SLACK)


def _walk(search: PlanningSearch, stage: Stage, ranking: Ranking) -> Iterator[RankedCandidate]:
    """Yields the candidates of a stage while its condition holds."""
    if not _goes_on(search, stage, ranking):
        return
    orders = {
        "arrival": ranking.by_arrival,
        "aspect": ranking.by_aspect,
        "bound": ranking.by_bound,
        "unlike": partial(_unlike_incumbent, search, ranking),
        "answer": partial(_incumbent_again, search),
    }
    candidates = orders.get(stage.order, lambda: ranking)()
    for ranked in islice(candidates, stage.candidates.start, stage.candidates.stop):
        yield ranked
        if not _goes_on(search, stage, ranking):
            return


def _unlike_incumbent(search: PlanningSearch, ranking: Ranking) -> list[RankedCandidate]:
    return [] if search.incumbent is None else ranking.unlike(search.incumbent.solution.trajectory)


def _incumbent_again(search: PlanningSearch) -> list[RankedCandidate]:
    """Returns the incumbent's release, with its motion; none without one."""
    if search.incumbent is None:
        return []
    made = search.incumbent.solution.trajectory
    return [RankedCandidate(search.problem, released(made, "the answer"), made)]


def _goes_on(search: PlanningSearch, stage: Stage, ranking: Ranking) -> bool:
    return not (search.is_optimal or search.out_of_time) and stage.condition(search, ranking)


def take_in_hand(search: PlanningSearch, ranking: Ranking) -> None:
    """Certifies a few of Ruckig's motions until the search has a valid one in hand, also past the deadline.

    They cost as much as a tenth of a search, so they are only made where the first stage of the optimiser gave no
    answer. One that lacks nothing but the release window ends this, too. They are no incumbents yet, lest a late motion
    in hand keep the search from sooner ones: a stage that comes to one of them takes it as it is.
    """
    begun = time.perf_counter()
    tried = 0
    for variant, ranked in product(IN_HAND_VARIANTS, islice(ranking, IN_HAND_CANDIDATES)):
        if search.answer is not None or search.nominal is not None:
            break
        certified = _made(search, ranked, variant, math.inf)
        if certified is None:
            continue
        tried += 1
        if certified.is_valid:
            search.in_hand = certified
        else:
            search.note_rejected(certified)
    if tried:
        valid = int(search.in_hand is not None)
        search.log_attempt("ruckig", f"in hand: {valid} of {tried} motions certified", begun)


def _made(
    search: PlanningSearch, ranked: RankedCandidate, variant: ruckig_otg.LaunchVariant, latest_s: float
) -> CertifiedSolution | None:
    """Returns Ruckig's motion to a candidate with its certificate, made once; None without one sooner than `latest_s`.

    Ruckig has none where a phase does not fit the tick grid; only its duration was known.
    """
    if variant not in ranked.made:
        try:
            solution = ruckig_otg.solve(search.problem, ranked.candidate, variant)
        except SolverFailed:
            return None
        if solution.trajectory.release_time_s >= latest_s:
            return None
        ranked.made[variant] = certified("ruckig", search.problem, solution)
    made = ranked.made[variant]
    return made if made.solution.trajectory.release_time_s < latest_s else None


def _certify_ruckig(search: PlanningSearch, stage: Stage, ranking: Ranking) -> None:
    """Certifies Ruckig's motions to the candidates of a stage where they are sooner than the incumbent."""
    begun = time.perf_counter()
    tried = 0
    valid = 0
    for ranked in _walk(search, stage, ranking):
        for variant in stage.variants:
            found = _ruckig_motion(search, ranked, variant)
            if found is not None:
                tried += 1
                valid += found.is_valid
                search.consider(found)
    if tried:
        result = f"{stage.purpose}: {valid} of {tried} motions certified"
        search.log_attempt("ruckig", result + ("; none can be sooner" if search.is_optimal else ""), begun)


def _ruckig_motion(
    search: PlanningSearch, ranked: RankedCandidate, variant: ruckig_otg.LaunchVariant
) -> CertifiedSolution | None:
    """Returns an untried motion that is sooner than the incumbent, with its certificate; None if there is none."""
    latest_s = search.release_time_s
    if ranked.candidate.bound_s >= latest_s or ranked.bound_s(variant) >= latest_s:
        return None
    if (variant == ruckig_otg.LAST_RESORT and search.incumbent is not None) or not ranked.first_try(variant):
        return None
    return _made(search, ranked, variant, latest_s)


def _optimise(search: PlanningSearch, stage: Stage, ranking: Ranking) -> None:
    """Optimises from the candidates of a stage."""
    begun = time.perf_counter()
    end = search.iterations + _budget(search.problem, stage)
    tried = 0
    solved = 0
    valid = 0
    failure = ""
    what = "ipopt" if stage.with_ipopt else "fatrop"
    for ranked in _walk(search, stage, ranking):
        if search.iterations >= end:
            break
        if not _may_gain(search, stage, ranking, ranked) or not ranked.first_try(what):
            continue
        begun += load_optimiser(search)
        tried += 1
        try:
            valid += _try_seed(search, ranking, ranked, end, stage)
            solved += 1
        except casadi_nlp.SeedFailed as error:
            failure = f"; {error}"
    if tried:
        made = f"{valid} of {solved} motions certified" if solved else f"no motion from {counted(tried, 'candidate')}"
        search.log_attempt("casadi", f"{stage.purpose}: {made}{failure}", begun)


def _budget(problem: ThrowProblem, stage: Stage) -> int:
    """Returns the iterations after which a stage ends: more with a release window, as each of its solves takes more."""
    return math.ceil(stage.iterations * (WINDOW_BUDGET if problem.is_robust else 1.0))


def _may_gain(search: PlanningSearch, stage: Stage, ranking: Ranking, ranked: RankedCandidate) -> bool:
    """Returns whether the optimiser may come to a sooner motion from a candidate.

    Not from one that lacks a brake, unless a motion through it is given. What is sooner than an answer is often in the
    aspect that it settled.
    """
    if ranked.given is None and search.lacks_brake(ranked.candidate):
        return False
    return stage.order in {"unlike", "answer"} or ranking.may_be_sooner(ranked, search.release_time_s)


def _try_seed(search: PlanningSearch, ranking: Ranking, ranked: RankedCandidate, end: int, stage: Stage) -> bool:
    """Returns whether a motion from a candidate was certified; notes what that says about its aspect and the search.

    A seed that is given up leaves doubt, but for those of some stages; where the release is given, or a point, not
    after one that led to a motion.
    """
    may_leave_doubt = isinstance(search.problem.release, TargetRelease) or not search.has_optimised
    leaves_doubt = stage.leaves_doubt and may_leave_doubt
    held = search.held
    settles = stage.order != "answer"
    try:
        was_valid = _optimise_from(search, ranked, end, stage)
    except casadi_nlp.SeedFailed as error:
        search.has_optimised |= error.is_late
        search.held = search.held if stage.leaves_doubt else held
        if error.is_late and settles:
            ranking.settle(ranked, math.inf)
        search.given_up += leaves_doubt and not error.is_late
        if error.lacks_brake:
            search.note_lack_of_brake(ranked.candidate)
        _note_outcome(search, ranked, error.is_late or not stage.leaves_doubt)
        raise
    _note_outcome(search, ranked, was_valid or not stage.leaves_doubt)
    if was_valid and settles:
        ranking.settle(ranked, search.certified[-1].solution.trajectory.release_time_s)
    search.given_up += leaves_doubt and not was_valid
    return was_valid


def _note_outcome(search: PlanningSearch, ranked: RankedCandidate, found_motion: bool) -> None:
    """Notes whether the optimiser came to a motion from a candidate by any of its seeds, unless a motion was given.

    One that leaves no doubt is noted as if it had.
    """
    if ranked.given is None:
        search.led_to_motion[ranked.candidate] = found_motion or search.led_to_motion.get(ranked.candidate, False)


def load_optimiser(search: PlanningSearch) -> float:
    """Loads the optimiser and returns how long that took [s]; the request's clock stands still meanwhile.

    Uncompiled solvers are noted in the log.
    """
    begun = time.perf_counter()
    compiled = casadi_nlp.load()
    taken = time.perf_counter() - begun
    search.extend_deadline(taken)
    if not compiled and all(attempt.result != NOT_COMPILED for attempt in search.attempts):
        search.log_attempt("casadi", NOT_COMPILED, begun)
    return taken


def _optimise_from(search: PlanningSearch, ranked: RankedCandidate, end: int, stage: Stage) -> bool:
    """Optimises from one candidate, from each of its seeds in turn; returns whether a motion was certified."""
    failure = None
    for seed in _seeds(search.problem, ranked, stage):
        failure = None
        try:
            if _optimise_from_seed(search, seed, end, stage):
                return True
        except casadi_nlp.SeedFailed as error:
            failure = error
            if error.is_late:
                break
    if failure is not None:
        raise failure
    return False


def _seeds(problem: ThrowProblem, ranked: RankedCandidate, stage: Stage) -> Iterator[Seed]:
    """Yields the seeds to try from a candidate, as `Stage.guess` has it; none is made before it is needed."""
    is_first = stage.guess == "gentle first" and isinstance(problem.release, TargetRelease)
    if not (problem.fixes_joints or problem.is_robust) and (is_first or stage.guess == "gentle"):
        yield ranked.gentle_seed
        if not is_first or ranked.seed is ranked.gentle_seed:
            return
    yield ranked.seed


def _optimise_from_seed(search: PlanningSearch, own: Seed, end: int, stage: Stage) -> bool:
    """Optimises from one seed; returns whether a motion was certified.

    After failed checks it solves again with wider margins, from that motion, or where that leads nowhere from the seed
    itself; where the checks failed between coarse stages, from it on finer stages.
    """
    margins = replace(casadi_nlp.DEFAULT_MARGINS, held=search.held)
    first = SolveOptions(
        margins, deadline_s=search.deadline_s, with_ipopt=stage.with_ipopt, latest_s=search.latest_useful_s
    )
    seeds = (own,)
    options = first
    for _ in range(stage.rounds):
        solution = _solve_from_any(search, seeds, options, end)
        found = search.certify("casadi", solution)
        if found.is_valid:
            return True
        certificate = found.certificate
        if _needs_finer_stages(search.problem, options, certificate.failures):
            held = margins.holding(certificate.failures, solution)
            seeds = (own,)
            options = replace(first, resolution="fine", margins=held)
            continue
        if not _has_remedy(search.problem, certificate.failures):
            return False
        cuts = _flight_cuts(search.problem, certificate.failures, solution.trajectory, options.margins)
        beyond_rad = _beyond_barrier(search.problem, certificate.failures, solution.trajectory)
        speed = partial(_tool_speed, search.problem, solution.trajectory)
        wider = options.margins.widened(certificate.failures, solution, cuts, beyond_rad, speed)
        if wider is None:
            return False
        seeds = Seed(own.candidate, solution.trajectory), own
        options = replace(options, margins=wider)
    return False


def _beyond_barrier(problem: ThrowProblem, failures: Iterable[Check], made: Trajectory) -> float:
    """Returns by how much a motion exceeds the barrier of two capsules that collide in it [rad]; negative within."""
    pairs = [check.detail for check in failures if check.name == "self_collision"]
    return max((problem.beyond_barrier(made.q, pair) for pair in pairs), default=-math.inf)


def _tool_speed(problem: ThrowProblem, made: Trajectory, at_s: float) -> float:
    """Returns the tool's speed in a motion at a time [s], over its limit."""
    q, qd, _ = made.at(np.array([at_s]))
    return float(np.linalg.norm(tool_state(problem.cell, q[0], qd[0]).v_WT)) / problem.limits.tcp_speed_max


def _has_remedy(problem: ThrowProblem, failures: Iterable[Check]) -> bool:
    """Returns whether another motion may do better: not where a flight that is given meets something but a link."""
    return isinstance(problem.release, TargetRelease) or any(
        check.name != "flight_clearance" or casadi_nlp.meets_arm(check) for check in failures
    )


def _flight_cuts(
    problem: ThrowProblem, failures: Iterable[Check], made: Trajectory, margins: casadi_nlp.Margins
) -> tuple[FlightEdge, ...]:
    """Returns the cuts that keep a throw like a failed one off the arm and the tool, which move with the throw.

    First the braking arm is to keep off the flight with more room. Boxes and a bin's rim have rows of their own. Where
    the release fixes the flight, cuts would leave no solution.
    """
    if not isinstance(problem.release, TargetRelease) or all(check.name != "flight_clearance" for check in failures):
        return ()
    if any(map(casadi_nlp.meets_base, failures)):
        return ()  # block "standing" keeps off that
    if any(map(casadi_nlp.meets_arm, failures)) and margins.passing_m == casadi_nlp.DEFAULT_MARGINS.passing_m:
        return ()
    met = flight_obstruction(problem, made)
    if met is None or met.obstacle == "rim" or met.obstacle.startswith("box"):
        return ()
    times = problem.release_speed_factor * met.flight_time_s  # as of an object with the tool's velocity, the formulas'
    return casadi_nlp.flight_cuts(times, met.direction, met.offset_m)


def _solve_from_any(search: PlanningSearch, seeds: Sequence[Seed], options: SolveOptions, end: int) -> Solution:
    """Returns the optimiser's motion from the first seed that leads to one, until it is clear that it is too late.

    Each solve has the iterations left until `search.iterations` reach `end`, and `SOLVE_ITERATIONS` in any case.
    """
    for seed in seeds[:-1]:
        try:
            return _solve(search, seed, _with_budget(search, options, end))
        except casadi_nlp.SeedFailed as error:
            if error.is_late:
                raise
    return _solve(search, seeds[-1], _with_budget(search, options, end))


def _with_budget(search: PlanningSearch, options: SolveOptions, end: int) -> SolveOptions:
    return replace(options, iteration_budget=max(end - search.iterations, SOLVE_ITERATIONS))


def _solve(search: PlanningSearch, seed: Seed, options: SolveOptions) -> Solution:
    """Returns the optimiser's motion from a seed; counts the iterations, also those of a failure."""
    try:
        solution = casadi_nlp.solve(search.problem, seed, options)
    except casadi_nlp.SeedFailed as error:
        search.iterations += error.iterations
        search.held |= error.held
        raise
    search.iterations += solution.iterations
    return solution


def _needs_finer_stages(problem: ThrowProblem, options: SolveOptions, failures: Iterable[Check]) -> bool:
    """Returns whether checks failed between coarse stages so that wider margins are no remedy."""
    may_be_finer = options.resolution == "coarse" and not problem.is_robust
    return may_be_finer and casadi_nlp.too_coarse(failures, options.margins)
