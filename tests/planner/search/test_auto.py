"""The search policy: budgets hold, clocks decide nothing but the deadline, and nothing beats a lower bound."""

import itertools
import math
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planner.search.policy import AGAIN_POLICY, FROM_ANSWER, UNLIKE

from benchmarks.problem_sets import build
from planner import planning
from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import instance
from planner.errors import CUT_SHORT, Infeasible, SolverFailed
from planner.plan_document import plan_document
from planner.planning import plan
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.search import (
    LAST_POLICY,
    POLICY,
    CertifiedSolution,
    PlanningSearch,
    Ranking,
    auto,
    policy,
    search_optimised,
    search_thoroughly,
)
from planner.search.auto import SOLVE_ITERATIONS
from planner.seeds import candidates
from planner.solution import Solution
from tests.planner.problems import cell, joint_problem, point_problem, pose_problem, random_state

CALL_ITERATIONS = 150  # no single call of a solver takes more, with the one that starts afresh


def target_problem(**changes):
    return joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])), **changes)


FAR_TARGET = joint_problem(release=TargetRelease(np.array([1.5, 0.5, 0.2])))
POINT_IN_REACH = joint_problem(release=PointRelease(np.array([0.5, 0.2, 0.6]), np.array([0.8, 0.3, 0.8])))


@pytest.fixture
def solves(monkeypatch):
    """Seed and options of every solve, recorded."""
    given = []
    solve = casadi_nlp.solve

    def recording(problem, seed, options):
        given.append((seed, options))
        return solve(problem, seed, options)

    monkeypatch.setattr(casadi_nlp, "solve", recording)
    return given


@pytest.mark.parametrize(("iterations", "window_s"), [(1, 0.02), (20, 0.02), (300, 0.02), (20, 0.0)])
def test_no_seed_is_begun_when_the_iterations_of_its_stage_are_spent(solves, iterations, window_s):
    """Half as many again with a release window. A seed that is begun has enough for a solve in any case."""
    problem = target_problem(release_window_s=window_s, landing_tolerance_m=0.005 if window_s else 0.0)
    stages = [replace(stage, iterations=iterations) for stage in POLICY if stage.purpose == "soonest seeds"]
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(problem, candidates(problem)), stages)
    allowed = math.ceil(1.5 * iterations) if window_s else iterations
    budgets = [options.iteration_budget for _, options in solves]
    assert budgets[0] == max(allowed, SOLVE_ITERATIONS)
    assert all(SOLVE_ITERATIONS <= budget <= budgets[0] for budget in budgets)
    assert search.iterations <= allowed + stages[0].rounds * (SOLVE_ITERATIONS + CALL_ITERATIONS)
    if allowed < SOLVE_ITERATIONS:
        assert len({id(seed.candidate) for seed, _ in solves}) == 1
    assert any(attempt.result.startswith("soonest seeds") for attempt in search.attempts)


def test_a_slow_clock_does_not_change_the_plan(monkeypatch):
    problem = target_problem(time_limit_s=60.0)
    quick = plan(problem)
    ticks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: 0.01 * next(ticks))
    slow = plan(problem)
    np.testing.assert_array_equal(slow.trajectory.q, quick.trajectory.q)
    assert slow.backend == quick.backend
    assert slow.solve_time_s > 0.05


def test_a_slow_clock_does_not_change_the_nearest_request(monkeypatch):
    problem = joint_problem(release=PointRelease(np.array([1.6, 0.2, 0.4]), np.array([0.5, 0.0, 0.5])))
    nearest = []
    ticks = itertools.count()
    for clock in (time.perf_counter, lambda: 0.01 * next(ticks)):
        monkeypatch.setattr(time, "perf_counter", clock)
        with pytest.raises(Infeasible) as refusal:
            plan(problem)
        nearest.append(refusal.value.nearest)
    assert nearest[0] is not None
    assert nearest[0] == nearest[1]


def test_loading_the_solvers_is_no_part_of_the_time_limit(monkeypatch):
    clock = [0.0]
    load = casadi_nlp.load

    def loads_slowly():
        clock[0] += 1000.0
        return load()

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(casadi_nlp, "load", loads_slowly)
    slow = plan(target_problem(time_limit_s=1.0, backend="casadi"))
    assert slow.backend == "casadi"
    assert slow.solve_time_s < 1.0


def test_a_plan_whose_search_the_time_limit_ended_says_so(monkeypatch):
    problem = target_problem()
    ticks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: 0.001 * next(ticks))
    search = PlanningSearch(problem, 1e6)
    search_thoroughly(search, candidates(problem))
    taken_s = 0.001 * next(ticks)
    cut = plan(replace(problem, time_limit_s=0.5 * taken_s))
    assert cut.certificate.valid
    assert cut.was_cut_short
    assert plan_document(cut, {}, "", "")["solver"]["status"] == f"{cut.status}; {CUT_SHORT}"
    whole = plan(problem)
    assert not whole.was_cut_short
    assert plan_document(whole, {}, "", "")["solver"]["status"] == whole.status


def test_a_way_home_beyond_the_time_limit_does_not_cut_the_plan_short(monkeypatch):
    clock = [0.0]
    find = planning.best_with_way_home

    def finds_late(search):
        clock[0] = 1e6
        return find(search)

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(planning, "best_with_way_home", finds_late)
    assert not plan(target_problem()).was_cut_short


def test_the_deadline_of_the_request_ends_the_search(solves):
    problem = target_problem()
    search = PlanningSearch(problem, time.perf_counter() - 1.0)
    search_optimised(search, Ranking(problem, candidates(problem)))
    assert solves == []
    assert isinstance(search.failure(), SolverFailed)


def test_nothing_is_optimised_after_a_motion_that_reaches_the_lower_bound(solves):
    problem = joint_problem()
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(problem, candidates(problem)))
    assert search.is_optimal
    assert 0.0 < search.lower_bound_s < search.release_time_s + problem.dt
    assert search.incumbent is not None
    assert search.incumbent.backend == "ruckig"
    assert solves == []


def test_casadi_requested_by_name_uses_the_optimiser_alone():
    problem = target_problem(backend="casadi")
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(problem, candidates(problem)))
    assert {attempt.backend for attempt in search.attempts} == {"casadi"}


def test_a_posture_without_a_brake_is_tried_once(monkeypatch):
    """Nor are those that differ by whole turns, nor is it tried under tighter limits."""
    tried = []

    def without_brake(problem, seed, options):
        tried.append(seed.candidate.q)
        raise casadi_nlp.SeedFailed("made to fail", 5, frozenset(), is_late=False, lacks_brake=True)

    monkeypatch.setattr(casadi_nlp, "solve", without_brake)
    here = cell("ur5e-sim")
    state = random_state(cell("ur5e-sim"), np.random.default_rng(3))
    problem = replace(pose_problem(here, *state), backend="casadi")
    found = candidates(problem)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_thoroughly(search, found)
    assert search.answer is None
    assert len(_postures([each.q for each in found])) < len(found)
    assert 2 <= len(tried) == len(_postures(tried))


def test_a_posture_that_led_to_a_motion_lacks_no_brake():
    here = cell("ur5e-sim")
    state = random_state(cell("ur5e-sim"), np.random.default_rng(3))
    problem = pose_problem(here, *state)
    first = candidates(problem)[0]
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    turned = replace(first, q=first.q + 2.0 * np.pi * np.eye(6)[5])
    search.led_to_motion[first] = True
    search.note_lack_of_brake(turned)
    assert not search.lacks_brake(turned)
    search.led_to_motion[first] = False
    search.note_lack_of_brake(turned)
    assert search.lacks_brake(first)


def _postures(states):
    """Returns joint positions (n, 6) but for whole turns."""
    return {tuple(np.round(np.concatenate([np.cos(q), np.sin(q)]), 6)) for q in states}


@pytest.mark.parametrize(
    ("problem", "spent", "tries"),
    [
        (target_problem(), 60, 2),
        (target_problem(), 61, 1),
        (target_problem(), 150, 1),
        (target_problem(), 151, 2),
        (target_problem(), 300, 2),
        (target_problem(), 301, 1),
        (target_problem(release_window_s=0.01, landing_tolerance_m=0.02), 5000, 1),
        (POINT_IN_REACH, 40, 1),
        (POINT_IN_REACH, 41, 0),
        (POINT_IN_REACH, 151, 0),
        (joint_problem(), 0, 0),
    ],
)
def test_what_is_unlike_an_answer_is_tried_once_or_twice(monkeypatch, problem, spent, tries):
    """Once a throw to a target is found, and again after few iterations or many; of a point once, after few."""
    begun = []

    def spending_nothing(search, ranked, *_):
        begun.append(ranked.candidate)
        return False

    monkeypatch.setattr(auto, "_optimise_from", spending_nothing)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    made = Solution(plan(joint_problem()).trajectory, "made before", 0, frozenset())
    ranking = Ranking(problem, candidates(problem))
    monkeypatch.setattr(ranking, "unlike", lambda _: [each for each in ranking if not each.tried])
    stages = [stage for stage in POLICY if stage.purpose == UNLIKE]
    search_optimised(search, ranking, stages)
    assert not begun  # without an answer
    search.consider(CertifiedSolution("casadi", made, SimpleNamespace(first_failure=None)))
    search.has_optimised = True
    search.iterations = spent
    search_optimised(search, ranking, stages)
    assert len(begun) == len(set(map(id, begun))) == tries
    assert (search.in_vain, search.given_up) == ([], 0)


@pytest.mark.parametrize("is_late", [False, True])
def test_what_is_unlike_an_answer_and_fails_leaves_no_doubt(monkeypatch, is_late):
    solve = casadi_nlp.solve
    begun = []

    def failing(problem, seed, options):
        if math.isinf(options.latest_s):
            return solve(problem, seed, options)
        begun.append(seed.candidate)
        raise casadi_nlp.SeedFailed("made to fail", 1, frozenset({"effort"}), is_late)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    monkeypatch.setattr(policy, "FEW_ITERATIONS", 1000)  # so that a second is tried, too
    problem = target_problem()
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    ranking = Ranking(problem, candidates(problem))
    search_optimised(search, ranking, [stage for stage in POLICY if stage.purpose in ("soonest seeds", UNLIKE)])
    assert search.incumbent is not None
    assert len(begun) == 2
    assert (search.in_vain, search.given_up, search.held) == ([], 0, frozenset())


@pytest.mark.parametrize("window_s", [0.0, 0.01])
def test_what_is_unlike_an_answer_begins_gently_unless_there_is_a_release_window(solves, window_s):
    problem = target_problem(release_window_s=window_s, landing_tolerance_m=0.02 if window_s else 0.0)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    ranking = Ranking(problem, candidates(problem))
    search_optimised(search, ranking, [stage for stage in POLICY if stage.purpose in ("soonest seeds", UNLIKE)])
    tried = {id(each.candidate): each for each in ranking}
    begun = [seed for seed, options in solves if math.isfinite(options.latest_s) and id(seed.candidate) in tried]
    assert begun
    for seed in begun:
        own = tried[id(seed.candidate)].seed.initial_guess
        gentle = tried[id(seed.candidate)].gentle_seed.initial_guess
        assert gentle.release_time_s > own.release_time_s
        assert seed.initial_guess.release_time_s == (own if window_s else gentle).release_time_s


@pytest.mark.parametrize(
    ("problem", "is_gentle"),
    [
        (FAR_TARGET, True),
        (POINT_IN_REACH, False),
        (target_problem(release_window_s=0.01, landing_tolerance_m=0.02), False),
        (joint_problem(), False),
    ],
)
def test_first_seeds_begin_gently_and_where_that_fails_from_the_soonest_motion(monkeypatch, problem, is_gentle):
    begun = []

    def failing(problem, seed, options):
        begun.append((id(seed.candidate), seed.initial_guess.release_time_s))
        raise casadi_nlp.SeedFailed("made to fail", 1, frozenset(), is_late=False)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    ranking = Ranking(problem, candidates(problem))
    search_optimised(search := PlanningSearch(problem, math.inf), ranking, [policy.FIRST_SEEDS])
    ranked = next(ranked for ranked in ranking if id(ranked.candidate) == begun[0][0])
    first = [released for candidate, released in begun if candidate == begun[0][0]]
    own, gentle = (seed.initial_guess.release_time_s for seed in (ranked.seed, ranked.gentle_seed))
    assert first == ([gentle, own] if is_gentle else [own])
    assert not is_gentle or gentle > own
    assert search.incumbent is None


@pytest.mark.parametrize("certified", [0, 1, 2])
def test_a_seeds_own_motion_is_the_guess_where_nothing_is_certified_from_a_gentle_one(monkeypatch, certified):
    begun = []

    def certifying(search, own, *_):
        begun.append(own)
        return len(begun) == certified

    monkeypatch.setattr(auto, "_optimise_from_seed", certifying)
    ranked = next(iter(Ranking(FAR_TARGET, candidates(FAR_TARGET)).by_aspect()))
    search = PlanningSearch(FAR_TARGET, math.inf)
    assert auto._optimise_from(search, ranked, 300, policy.FIRST_SEEDS) == (certified > 0)
    assert begun == [ranked.gentle_seed, ranked.seed][: certified or 2]


def test_a_candidate_is_left_where_its_gentle_motion_is_too_late(monkeypatch):
    begun = []

    def late(search, own, *_):
        begun.append(own)
        raise casadi_nlp.SeedFailed("made to be late", 1, frozenset(), is_late=True)

    monkeypatch.setattr(auto, "_optimise_from_seed", late)
    ranked = next(iter(Ranking(FAR_TARGET, candidates(FAR_TARGET)).by_aspect()))
    with pytest.raises(casadi_nlp.SeedFailed):
        auto._optimise_from(PlanningSearch(FAR_TARGET, math.inf), ranked, 300, policy.FIRST_SEEDS)
    assert begun == [ranked.gentle_seed]


def test_a_throw_is_sooner_by_what_is_least_like_the_first_answer():
    problem = build("robust-anywhere", 22, 0)[-1].problem
    with_others = plan(problem).trajectory.release_time_s
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    stages = [stage for stage in POLICY if stage.purpose != UNLIKE]
    search_optimised(search, Ranking(problem, candidates(problem)), stages)
    assert with_others < 0.9 * search.release_time_s  # 0.314 and 0.432 s


def test_an_answer_whose_stages_do_not_fit_is_sooner_when_solved_again():
    problem = build("target-anywhere", 15, 0)[-1].problem
    again = plan(problem)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    stages = [stage for stage in POLICY if stage.purpose != FROM_ANSWER]
    search_optimised(search, Ranking(problem, candidates(problem)), stages)
    assert search.incumbent is not None
    assert not search.incumbent.solution.stages_fit
    assert again.trajectory.release_time_s < 0.9 * search.release_time_s  # 0.102 and 0.122 s
    assert again.certificate.valid


@pytest.mark.parametrize("rejected", [False, True])
def test_an_answer_is_solved_again_once_if_its_stages_do_not_fit(monkeypatch, solves, rejected):
    """From its own motion, whatever the certificate says of what comes of it."""
    problem = target_problem()
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    ranking = Ranking(problem, candidates(problem))
    search_optimised(search, ranking, [stage for stage in POLICY if stage.purpose == "soonest seeds"])
    first = search.incumbent
    stages = [stage for stage in POLICY if stage.purpose == FROM_ANSWER]
    assert first is not None
    solves.clear()
    search.incumbent = replace(first, solution=replace(first.solution, stages_fit=True))
    search_optimised(search, ranking, stages)
    assert not solves
    search.incumbent = replace(first, solution=replace(first.solution, stages_fit=False))
    if rejected:
        solve = casadi_nlp.solve
        monkeypatch.setattr(casadi_nlp, "solve", lambda p, s, o: solve(p, s, replace(o, latest_s=math.inf)))
        monkeypatch.setattr(CertifiedSolution, "is_valid", False)
    search_optimised(search, ranking, stages)
    ((seed, options),) = solves
    assert seed.initial_guess is first.solution.trajectory
    sooner_s = first.solution.trajectory.release_time_s - problem.dt
    assert options.latest_s == (math.inf if rejected else pytest.approx(sooner_s))


@pytest.mark.parametrize(
    ("change", "pays"),
    [
        ({}, False),
        ({"stages_fit": False}, True),
        ({"window_s": 0.01}, True),
        ({"stages_fit": False, "iterations": 400}, True),
        ({"stages_fit": False, "iterations": 401}, False),
        ({"window_s": 0.01, "iterations": 401}, False),
        ({"stages_fit": False, "backend": "ruckig"}, False),
        ({"stages_fit": False, "needs_sooner": True}, False),
        ({"stages_fit": False, "has_optimised": False}, False),
    ],
)
def test_when_an_answer_is_solved_again(change, pays):
    """With a window, or where its stages do not fit; not after a long search, nor a motion of another's."""
    window_s = change.get("window_s", 0.0)
    problem = target_problem(release_window_s=window_s, landing_tolerance_m=0.02 if window_s else 0.0)
    solution = Solution(plan(target_problem()).trajectory, "", stages_fit=change.get("stages_fit", True))
    search = PlanningSearch(problem, time.perf_counter() + 60.0, iterations=change.get("iterations", 100))
    search.incumbent = CertifiedSolution(change.get("backend", "casadi"), solution, SimpleNamespace(first_failure=None))
    search.has_optimised, search.needs_sooner = change.get("has_optimised", True), change.get("needs_sooner", False)
    ranking = Ranking(problem, candidates(problem))
    assert policy.answer_again_pays(search, ranking) == pays
    (stage,) = [stage for stage in POLICY if stage.purpose == FROM_ANSWER]
    assert stage.condition is policy.answer_again_pays


def test_maps_and_repeats_of_an_answer_do_not_solve_it_again():
    purposes = {stage.purpose for stage in (*policy.SHORT_POLICY, *AGAIN_POLICY)}
    assert not purposes & {FROM_ANSWER, UNLIKE}
    assert {FROM_ANSWER, UNLIKE} <= {stage.purpose for stage in policy.FIRST_AGAIN_POLICY}


@pytest.mark.parametrize("window_s", [0.0, 0.01])
@pytest.mark.parametrize("optimised", [False, True])
def test_ruckig_is_not_tried_where_a_throw_with_a_window_was_optimised(window_s, optimised):
    problem = target_problem(release_window_s=window_s, landing_tolerance_m=0.02 if window_s else 0.0)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    ranking = Ranking(problem, candidates(problem))
    made = Solution(plan(target_problem()).trajectory, "")
    search.incumbent = CertifiedSolution("casadi", made, SimpleNamespace(first_failure=None))
    search.has_optimised = optimised
    stages = [stage for stage in POLICY if stage.purpose in ("sooner motions", "further motions")]
    tried = [stage.condition(search, ranking) for stage in stages]
    assert tried == 3 * [not (window_s and optimised)]


def test_no_candidate_is_left_out_between_two_stages():
    for backend in ("casadi", "ruckig"):
        rows = [
            stage.candidates for stage in (*POLICY, *LAST_POLICY) if stage.backend == backend and stage.order == "rank"
        ]
        tried = 0
        for row in rows:
            assert row.start <= tried
            tried = max(tried, row.stop)


def test_no_motion_by_ruckig_keeps_the_optimiser_from_a_seed():
    """So `auto` walks every stage of the first search that `casadi` alone does."""
    problem = target_problem()
    ranking = Ranking(problem, candidates(problem))
    without, with_ruckig = (PlanningSearch(problem, time.perf_counter() + 60.0) for _ in range(2))
    made = ruckig_otg.solve(problem, ranking[0].candidate, "synchronised")
    with_ruckig.consider(CertifiedSolution("ruckig", made, SimpleNamespace(first_failure=None)))
    assert with_ruckig.incumbent is not None
    for stage in (*POLICY, *AGAIN_POLICY):
        if stage.backend == "casadi":
            assert stage.condition(without, ranking) == stage.condition(with_ruckig, ranking)


def test_a_point_is_thrown_from_another_aspect_where_that_is_sooner():
    here = cell()
    rng = np.random.default_rng(1)
    problem = [point_problem(here, *random_state(here, rng)) for _ in range(21)][-1]
    released = []
    for purposes in ({"soonest seeds"}, {"soonest seeds", "other aspects"}):
        search = PlanningSearch(problem, time.perf_counter() + 60.0)
        stages = [stage for stage in POLICY if stage.purpose in purposes]
        search_optimised(search, Ranking(problem, candidates(problem)), stages)
        released.append(search.release_time_s)
    assert released[1] < 0.9 * released[0] < np.inf


BESIDE_THE_OPENING = joint_problem(
    start=np.array([-1.148, -1.156, 0.301, -2.138, -0.279, -0.129]),
    release=TargetRelease(np.array([0.362, -0.627, 0.0])),
    time_limit_s=60.0,
)


def test_an_object_that_would_leave_beside_the_opening_is_followed_out_of_the_grip(solves):
    """From the motion that leaves beside it, with the rows of that one. A throw that leaves well is not followed."""
    plain = PlanningSearch(target_problem(), time.perf_counter() + 60.0)
    search_optimised(plain, Ranking(plain.problem, candidates(plain.problem)))
    assert solves
    assert not any(options.margins.leaves for _, options in solves)
    solves.clear()
    search = PlanningSearch(BESIDE_THE_OPENING, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(search.problem, candidates(search.problem)))
    followed = [(seed, options) for seed, options in solves if options.margins.leaves]
    assert followed
    seed, options = followed[0]
    margins = options.margins
    beside = next(each for each in search.rejected if each.solution.trajectory is seed.initial_guess)
    assert "opening_direction" in {check.name for check in beside.certificate.failures}
    assert beside.solution.held <= margins.held
    assert search.release_time_s < 1.1 * beside.solution.trajectory.release_time_s


def test_a_remedy_has_iterations_where_its_stage_has_none_left(solves):
    """The first motion leaves beside the opening; the stage's iterations suffice for that one alone."""
    search = PlanningSearch(BESIDE_THE_OPENING, time.perf_counter() + 60.0)
    stages = [replace(stage, iterations=30) for stage in POLICY if stage.purpose == "soonest seeds"]
    search_optimised(search, Ranking(search.problem, candidates(search.problem)), stages)
    assert [options.iteration_budget for _, options in solves][:2] == [SOLVE_ITERATIONS] * 2
    assert solves[1][1].margins.leaves
    assert search.incumbent is not None


@pytest.mark.parametrize("is_late", [False, True])
def test_a_remedy_that_fails_from_the_motion_is_begun_from_the_candidates_own_seed(monkeypatch, is_late):
    """With the same margins; but not where the motion would only come too late."""
    given = []
    solve = casadi_nlp.solve

    def failing_from_motions(problem, seed, options):
        given.append((seed, options))
        if len(given) == 2:
            raise casadi_nlp.SeedFailed("gave up", 100, frozenset(), is_late)
        return solve(problem, seed, options)

    monkeypatch.setattr(casadi_nlp, "solve", failing_from_motions)
    search = PlanningSearch(BESIDE_THE_OPENING, time.perf_counter() + 60.0)
    stages = [replace(stage, candidates=slice(0, 1)) for stage in POLICY if stage.purpose == "soonest seeds"]
    search_optimised(search, Ranking(search.problem, candidates(search.problem)), stages)
    (first, _), (from_motion, wider), *others = given
    assert from_motion.initial_guess is search.rejected[0].solution.trajectory
    assert (search.incumbent is None) == is_late
    if is_late:
        assert not others
        return
    own, options = others[0]
    assert own is first
    assert options.margins == wider.margins


@pytest.mark.parametrize(
    ("p_W", "most"),  # to the first it is stuck in a local minimum, 14 ms later
    [([1.2, 0.3, 0.0], 1.03), ([1.3, 0.0, 0.0], 1.0), ([1.0, -0.5, 0.0], 1.0), ([0.9, 0.6, 0.2], 1.0)],
)
def test_a_weak_gripper_throws_as_soon_as_with_a_release_window(p_W, most):
    """The first was refused without a window, as the grip held too much between the knots of every motion."""
    here = cell()
    weak = replace(here, gripper=replace(here.gripper, hold_acceleration_m_s2=np.array([12.0])))
    released = []
    for window_s, tolerance_m in ((0.0, 0.0), (0.005, 0.02)):
        problem = target_problem(cell=weak, release_window_s=window_s, landing_tolerance_m=tolerance_m)
        search = PlanningSearch(replace(problem, release=TargetRelease(np.array(p_W))), math.inf)
        search_optimised(search, Ranking(search.problem, candidates(search.problem)))
        released.append(search.release_time_s)
    assert released[0] <= most * released[1] < np.inf


CLOSE_TO_ITSELF = ThrowProblem(
    (ur5 := cell("ur5-sim")),
    start=np.array([-1.246, -1.047, 0.232, -1.692, -1.337, -0.051]),
    release=PointRelease(np.array([0.256, -0.332, 0.377]), np.array([-0.551, -0.595, 0.869])),
    limits=ur5.limits,
    time_limit_s=60.0,
)


def test_what_comes_too_close_between_stages_is_solved_on_finer_ones_with_its_own_rows(solves):
    """From the start, not from the motion that did; rows that it did not need are left out again."""
    search = PlanningSearch(CLOSE_TO_ITSELF, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(search.problem, candidates(search.problem)))
    given = [(options.resolution, options.margins.held) for _, options in solves[:4]]
    clear = frozenset({"clearance"})
    assert given == [("coarse", frozenset()), ("coarse", clear), ("fine", clear), ("fine", clear)]
    assert solves[2][0].initial_guess is solves[0][0].initial_guess
    assert search.incumbent is not None
    assert search.incumbent.solution.held == clear


BESIDE_THE_FOOT = {"ur5-sim": [0.0181, -0.0847, 0.0], "ur10e-sim": [0.0875, 0.0688, 0.0]}


@pytest.mark.parametrize("name", list(BESIDE_THE_FOOT))
@pytest.mark.parametrize("window_s", [0.0, 0.02])
def test_a_throw_to_a_place_beside_the_foot_passes_it(solves, name, window_s):
    """Of the benchmark, where it took more than a second, or was refused with a window."""
    here = cell(name)
    window = {"release_window_s": window_s, "landing_tolerance_m": 0.005} if window_s else {}
    release = TargetRelease(np.array(BESIDE_THE_FOOT[name]))
    problem = ThrowProblem(here, here.home, release, here.limits, time_limit_s=60.0, **window)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_optimised(search, Ranking(problem, candidates(problem)))
    assert search.incumbent is not None
    assert any("standing" in found.solution.held for found in search.certified)
    optimised = [found.certificate for found in search.rejected if found.backend == "casadi"]
    assert all(check.detail not in ("foot", "base") for made in optimised for check in made.failures)


BACK_OVER_THE_ARM = {
    "target": (TargetRelease(np.array([0.761, -0.095, 0.0])), "ur5-sim", [0.21, -2.79, 0.51, -0.47, -2.42, 0.21]),
    "point": (
        PointRelease(np.array([0.0194, -0.3121, 0.3061]), np.array([0.791, 1.284, 0.472])),
        "ur5e-sim",
        [0.17, -1.54, 1.4, -0.49, -2.13, -0.03],
    ),
}


@pytest.mark.parametrize("kind", BACK_OVER_THE_ARM)
def test_an_arm_brakes_out_of_the_way_of_a_throw_back_over_it(monkeypatch, kind):
    """Where the brake is the shortest, the object meets the arm at rest. Another release is later by half, or more."""
    release, name, start = BACK_OVER_THE_ARM[kind]
    problem = joint_problem(name, release=release, start=np.array(start), time_limit_s=60.0)
    groups_of = instance._applicable_groups
    stages = [stage for stage in POLICY if stage.purpose in {"soonest seeds", "other aspects"}]

    def soonest(groups):
        monkeypatch.setattr(instance, "_applicable_groups", groups)
        search = PlanningSearch(problem, time.perf_counter() + 60.0)
        search_optimised(search, Ranking(problem, candidates(problem)), stages)
        return search.release_time_s

    stays = soonest(lambda *of: tuple(group for group in groups_of(*of) if group != "passing"))
    assert soonest(groups_of) < 0.7 * stays
