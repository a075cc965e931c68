"""The only entry of the planner: `plan(problem)` returns a certified motion, or raises with the reason."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from planner.answer import Attempt, Plan
from planner.approach import Approach
from planner.certificate import certify, release_flight
from planner.errors import TIME_LIMIT, Infeasible, InvalidProblem, SolverFailed, Violation, nothing_found
from planner.passages import first_release
from planner.problem import TIME_LIMIT_S, ThrowProblem
from planner.progress import SILENT, ProgressMeter
from planner.refusal import nearest_problem, of_candidates, refuse_impossible
from planner.request import request_document
from planner.search import (
    CertifiedSolution,
    PlanningSearch,
    best_with_way_home,
    certified_brake,
    load_libraries,
    optimise_from,
    search_after_brake,
    search_candidates,
    search_chain,
    search_with_stop,
)
from planner.seeds import Candidate, NoCandidates, ReleaseState, candidates, neighbour_candidates
from planner.trajectory import Trajectory


@dataclass(frozen=True)
class SearchHints:
    """What a caller of the planner wants or knows beside the problem.

    Attributes:
        releases: release states of plans for other targets: a short search starts from these alone. Empty: an ordinary
            search from candidates of its own.
        offers_nearest: whether a refusal carries a feasible request near it, the larger part of most refusals' time.
        meter: tells an observer of the progress, in all searches that it is given to.
        nearby: a throw from the problem's start at another target, such as what is left of the one that the plan is to
            replace. Where it lands near the problem's own target it is moved to that first, which ends the search
            where that is certified. Of a target that moves it also says when the first landing may be.
        lands_at_s: the landing to try first at a target that moves [s, controller's clock]. None: about the soonest.
    """

    releases: tuple[ReleaseState, ...] = ()
    offers_nearest: bool = True
    meter: ProgressMeter = SILENT
    nearby: Trajectory | None = None
    lands_at_s: float | None = None


ORDINARY = SearchHints()
# [s] Landings of throws at a target that moves: the first one after the earliest start leaves room for most launches
# and flights (0.5 to 0.8 s on the shipped cells); while there is none, later ones.
FIRST_LANDING_S = 0.8
LANDING_STEP_S = 0.5
LANDINGS_MAX = 12
SPARE_S = 0.05  # [s] for a motion that takes a little longer to where the target is then
MOVED_BY = ("auto", "casadi")  # back ends with the optimiser, which moves a throw
MOVED_M = 0.2  # [m] from where a throw lands, at most: farther off another posture may throw twice as soon
LAUNCH_MAX_S = 1.0  # [s] until its release; a throw with more left waits for something, which the new one need not
NEAREST_ATTEMPT = "nearest"
NEAREST_CUT_SHORT = "time_limit_s passed before every nearer request was tried"
NO_RELEASE_STATE = "no release state was found"


def plan(problem: ThrowProblem, hints: SearchHints = ORDINARY) -> Plan:
    """Returns the best certified motion for the problem.

    The clock of `time_limit_s` starts once the libraries are loaded, and stands still while solvers are.

    Args:
        problem: to be solved.
        hints: where the search starts, and what a refusal offers.

    Raises:
        Infeasible: the search for a certified motion ran to its end in vain, or none exists; carries the constraints
            in the way, each proven or not, and a feasible request near it.
        SolverFailed: the time limit ended the search before that; carries the same.
        BackendUnavailable: the requested back end is not installed.
    """
    return _search(problem, hints) if problem.moving is None else _plan_to_meet(problem, hints)


def _plan_to_meet(problem: ThrowProblem, hints: SearchHints) -> Plan:
    """Returns the best certified motion to a target that moves, with the instant at which it starts.

    It is the throw to where the target is at the landing, begun as long before: at the first of the landings tried, for
    which there is one. Before its start it waits. Other passages are parts of the motion, and wait with it.

    Raises:
        PlannerError: as of `plan`, for the last landing that was tried.
        InvalidProblem: the target's place at the landing is too uncertain.
    """
    assert problem.starts_not_before_s is not None
    earliest_s = problem.starts_not_before_s
    ends_s = time.perf_counter() + problem.time_limit_s
    hints = replace(hints, offers_nearest=False)
    refusal: Infeasible = Infeasible(())
    attempts: list[Attempt] = []
    solve_time_s = 0.0
    lands_at_s = earliest_s + _first_landing_s(problem, hints) if hints.lands_at_s is None else hints.lands_at_s
    for _ in range(LANDINGS_MAX):
        left_s = ends_s - time.perf_counter()
        if left_s <= 0.0:
            raise SolverFailed(TIME_LIMIT, violations=refusal.violations)
        try:
            met = problem.met_at(lands_at_s)
        except InvalidProblem:  # by then nobody knows where the target is
            if not refusal.violations:
                raise
            break
        try:
            found = _search(replace(met, time_limit_s=left_s), hints)
        except Infeasible as refused:
            refusal = refused
            lands_at_s += LANDING_STEP_S
            continue
        attempts += found.attempts
        solve_time_s += found.solve_time_s
        takes_s = _takes_s(found.problem, found.trajectory)
        assert takes_s is not None  # the certificate has followed the flight
        if lands_at_s - takes_s >= earliest_s:
            found = replace(found, attempts=tuple(attempts), solve_time_s=solve_time_s)
            return _starting(found, lands_at_s - takes_s, problem.time_limit_s)
        hints = replace(hints, nearby=found.trajectory)
        lands_at_s = earliest_s + takes_s + SPARE_S
    span = f"landings up to {lands_at_s - earliest_s:.1f} s after the earliest start"
    if not refusal.violations:
        raise Infeasible([nothing_found("landing", f"no throw meets the target at {span}")])
    # Each is proven of one landing at most, and the target goes on.
    raise Infeasible(
        [replace(each, proven=False).within(span) for each in refusal.violations], attempts=refusal.attempts
    )


def _takes_s(problem: ThrowProblem, throw: Trajectory) -> float | None:
    """Returns the time from the start of a throw to its landing [s]; None if it never lands."""
    flight = release_flight(problem, throw)
    return None if flight is None else throw.release_time_s + flight.time_of_flight_s


def _first_landing_s(problem: ThrowProblem, hints: SearchHints) -> float:
    """Returns how long after the earliest start the first landing to try is [s]: about that of a throw nearby."""
    nearby = hints.nearby
    takes_s = None if nearby is None or nearby.release_time_s > LAUNCH_MAX_S else _takes_s(problem, nearby)
    return _passed_before_s(problem, hints) + FIRST_LANDING_S if takes_s is None else takes_s + SPARE_S


def _passed_before_s(problem: ThrowProblem, hints: SearchHints) -> float:
    """Returns how long after its start a motion can throw, about: what the passages before take by themselves [s].

    Where these have no motion of their own, or the throw is later, it is the time that the throw is not before.
    """
    number = first_release(problem.passages)
    if number is None:
        return 0.0
    throw = problem.passages[number]
    passed_s = max(throw.not_before_s, throw.at_s or 0.0)
    if number == 0:
        return passed_s
    try:
        found = _search(problem.up_to(number), hints)
    except (Infeasible, SolverFailed):  # with the throw they may have one: the search for the whole says why not
        return passed_s
    return max(passed_s, found.trajectory.passed[-1] * found.trajectory.dt)


def _starting(found: Plan, starts_at_s: float, time_limit_s: float) -> Plan:
    """Returns a plan that starts at an instant of the controller's clock [s], certified for that."""
    problem = replace(found.problem, starts_at_s=starts_at_s, time_limit_s=time_limit_s)
    certificate = certify(problem, found.trajectory)
    if not certificate.valid:
        raise Infeasible([Violation("landing", math.inf, 0.0, "m", detail="bug in Fling: the target is not met")])
    return replace(found, problem=problem, certificate=certificate)


def _search(problem: ThrowProblem, hints: SearchHints) -> Plan:
    """Returns the best certified motion of one search; raises as `plan` does."""
    load_libraries(problem.backend)
    begun_s = time.perf_counter()
    search = PlanningSearch(problem, begun_s + problem.time_limit_s, tell=hints.meter.step)
    hints.meter.begin("search")
    try:
        refuse_impossible(problem)
        moved = _moved(search, hints.nearby)
        if moved is None:
            _search_anew(search, hints.releases)
        best, way_home = moved or best_with_way_home(search)
    except (Infeasible, SolverFailed) as refusal:
        _tell_of_passage(refusal, problem)
        _tell_of_brake(refusal, problem)
        if hints.offers_nearest and not problem.is_chain:
            hints.meter.begin("nearest")
            _offer_nearest(refusal, search)
        raise
    return Plan(
        problem=problem,
        backend=best.backend,
        trajectory=best.solution.trajectory,
        certificate=best.certificate,
        status=best.solution.status,
        iterations=best.solution.iterations,
        solve_time_s=time.perf_counter() - begun_s - search.loading_s,
        attempts=tuple(search.attempts),
        way_home=way_home,
        was_cut_short=search.was_cut_short,
    )


def _moved(search: PlanningSearch, throw: Trajectory | None) -> tuple[CertifiedSolution, Approach] | None:
    """Returns a throw moved to a search's target, with its way home; None where that is not certified.

    What it finds is none of the search's own: a motion without a way home must not bar the later ones.
    """
    problem = search.problem
    # Of a motion that is to be joined, the gripper is told to open after the start.
    soonest_s = 0.0 if problem.starts_at_rest else problem.cell.gripper.delay_s + problem.dt
    if throw is None or not _can_move(problem, throw, soonest_s):
        return None
    moved = None
    with search.inner(problem) as inside:
        optimise_from(inside, throw)
        if inside.best is not None and inside.release_time_s >= soonest_s:
            moved = best_with_way_home(inside)
    search.attempts += inside.attempts
    search.note_end()
    return moved


def _can_move(problem: ThrowProblem, throw: Trajectory, soonest_s: float) -> bool:
    """Returns whether a throw may be moved to a problem's target: one throw of a ball, soon, near, by the optimiser.

    The joints at the release of a body are fixed by how it is to land: those of the old target lead nowhere.
    """
    target = problem.target
    if problem.is_chain or target is None or problem.fixes_joints or problem.backend not in MOVED_BY:
        return False
    if not soonest_s <= throw.release_time_s <= LAUNCH_MAX_S:
        return False
    flight = release_flight(problem, throw)
    return flight is not None and math.dist(flight.landing_point, target.p_W) <= MOVED_M


def _search_anew(search: PlanningSearch, releases: Sequence[ReleaseState]) -> None:
    """Searches for the best certified motion, from other plans' release states alone where some are given.

    Raises:
        Infeasible: there are no candidates; or of several passages as `search_chain` does.
        SolverFailed: the deadline passed before one was found.
    """
    problem = search.problem
    if problem.is_chain:
        search_chain(search)
        return
    found = _candidates(search, releases)
    search_candidates(search, found)
    search.note_end()
    if search.best is None and problem.backend == "auto" and not releases:
        _fall_back(search, found)


def _fall_back(search: PlanningSearch, found: Sequence[Candidate]) -> None:
    """Looks for a motion with a pause on the way: at a posture to throw from, or where the start in motion is braked.

    Args:
        search: without a motion; updated in place.
        found: candidates of its problem.
    """
    if search.problem.starts_at_rest:
        search_with_stop(search, found)
    else:
        search_after_brake(search)


def _candidates(search: PlanningSearch, releases: Sequence[ReleaseState]) -> list[Candidate]:
    """Returns a search's candidates, from other plans' release states where some are given.

    Without any, what was looked at is an attempt of the search.

    Raises:
        Infeasible: there are none.
        SolverFailed: the deadline passed before one was found.
    """
    problem = search.problem
    begun_s = time.perf_counter()
    try:
        return neighbour_candidates(problem, releases) if releases else candidates(problem, search.deadline_s)
    except Infeasible as refusal:
        tried = refusal.tried if isinstance(refusal, NoCandidates) else NO_RELEASE_STATE
        search.log_attempt("candidates", tried, begun_s)
        raise Infeasible(of_candidates(problem, refusal.violations), attempts=search.log) from None
    except SolverFailed as cut_short:
        search.log_attempt("candidates", NO_RELEASE_STATE, begun_s)
        raise SolverFailed(cut_short.status, attempts=search.log, violations=cut_short.violations) from None


def _tell_of_passage(refusal: Infeasible | SolverFailed, problem: ThrowProblem) -> None:
    """Leaves the release out of what stands in the way of a single passage that lets nothing go, and names it."""
    if problem.passages and not (problem.is_chain or problem.throws):
        where = f"passage {problem.passages[0].name!r}"
        refusal.violations = tuple(each.in_passing().within(where) for each in refusal.violations)
        status = [refusal.status] if isinstance(refusal, SolverFailed) else []
        refusal.args = ("; ".join([*status, *map(str, refusal.violations)]),)


def _tell_of_brake(refusal: Infeasible | SolverFailed, problem: ThrowProblem) -> None:
    """Adds to a refusal what stands in the way of a brake from a start in motion, if anything does."""
    if problem.starts_at_rest or any(each.proven for each in refusal.violations):
        return
    brake = certified_brake(problem)
    if isinstance(brake, Violation):
        refusal.violations = (*refusal.violations, brake)
        refusal.args = (f"{refusal}; {brake}",)


def _offer_nearest(refusal: Infeasible | SolverFailed, search: PlanningSearch) -> None:
    """Gives a refusal a feasible request near the refused one, if one was found.

    Where the request's time limit passed before that, fewer were tried: an attempt says so, and the offer has the usual
    limit, so that it can be posted as it is.
    """
    begun_s = time.perf_counter()
    found = nearest_problem(search)
    if search.out_of_time:
        search.log_attempt(NEAREST_ATTEMPT, NEAREST_CUT_SHORT, begun_s)
        refusal.attempts = (*refusal.attempts, search.log[-1])
    if found is None:
        return
    if search.out_of_time:
        found = replace(found, time_limit_s=max(found.time_limit_s, TIME_LIMIT_S))
    refusal.nearest = request_document(found, found.release)
