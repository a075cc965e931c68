"""The search: bounds exclude, counts end it and clocks do not, and every back end is asked as it was requested."""

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from planner import planning
from planner.answer import plan_document
from planner.backends import casadi_nlp
from planner.backends.casadi_nlp import instance
from planner.certificate import certify
from planner.errors import CUT_SHORT, Infeasible, SolverFailed
from planner.planning import plan
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.request import problem_from_request
from planner.search import PlanningSearch, search_candidates
from planner.search.search import CANDIDATES, MOTIONS
from planner.seeds import aspects, candidates, first_rows, least_times_to_aspects
from tests.planner.problems import cell, ideal_cell, joint_problem, pose_problem, steady_cell


def target_problem(**changes):
    return joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])), **changes)


def searched(problem: ThrowProblem) -> PlanningSearch:
    search = PlanningSearch(problem, time.perf_counter() + 100.0)
    search_candidates(search, candidates(problem))
    return search


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


def test_a_slow_clock_does_not_change_the_plan(monkeypatch):
    problem = target_problem(time_limit_s=60.0)
    quick = plan(problem)
    ticks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: 0.01 * next(ticks))
    slow = plan(problem)
    np.testing.assert_array_equal(slow.trajectory.q, quick.trajectory.q)
    assert slow.backend == quick.backend
    assert slow.solve_time_s > 0.05


def test_loading_the_optimiser_is_no_part_of_the_time_limit(monkeypatch):
    clock = [0.0]
    load = casadi_nlp.load
    loaded = []

    def loads_slowly():
        if not loaded:
            clock[0] += 1000.0
        loaded.append(True)
        return load()

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(casadi_nlp, "load", loads_slowly)
    slow = plan(target_problem(time_limit_s=1.0, backend="casadi"))
    assert slow.backend == "casadi"
    assert slow.solve_time_s < 1.0


def test_a_plan_whose_search_the_time_limit_ended_says_so(monkeypatch):
    problem = target_problem()
    clock = [0.0]
    solve = casadi_nlp.solve

    def takes_long(*given):
        found = solve(*given)
        clock[0] += 100.0
        return found

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(casadi_nlp, "solve", takes_long)
    whole = plan(problem)
    assert not whole.was_cut_short
    assert plan_document(whole, {}, "", "")["solver"]["status"] == whole.status
    cut = plan(replace(problem, time_limit_s=50.0))
    assert cut.certificate.valid
    assert cut.was_cut_short
    assert plan_document(cut, {}, "", "")["solver"]["status"] == f"{cut.status}; {CUT_SHORT}"


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
    search_candidates(search, candidates(problem))
    assert solves == []
    assert isinstance(search.failure(search.violations()), SolverFailed)


def test_nothing_is_optimised_after_a_motion_that_reaches_the_lower_bound(solves):
    search = searched(joint_problem())
    assert search.best is not None
    assert search.best.backend == "ruckig"
    assert solves == []


def test_the_soonest_candidate_of_every_aspect_is_tried_first_and_none_that_is_excluded(solves):
    """From other aspects the arm releases later than from its own here: their bounds exclude them."""
    problem = target_problem()
    search = searched(problem)
    tried = list({id(seed.candidate): seed.candidate for seed, _ in solves}.values())
    of = aspects(problem.cell.robot, np.array([each.q for each in tried]))
    first = [tried[row].bound_s for row in first_rows(of)]
    assert first == sorted(first)
    assert least_times_to_aspects(problem)[of].max() < search.release_time_s
    assert len(tried) <= CANDIDATES


@pytest.mark.parametrize("fails", [0, 2, 6, 99])
def test_candidates_are_tried_until_two_led_to_a_motion(monkeypatch, fails):
    tried = []

    def optimised(search, candidate):
        tried.append(candidate)
        return len(tried) > fails

    monkeypatch.setattr("planner.search.search.optimise", optimised)
    monkeypatch.setattr(PlanningSearch, "is_of_use", lambda search, least_s: True)
    problem = target_problem(backend="casadi")
    search_candidates(PlanningSearch(problem, math.inf), candidates(problem))
    assert len(tried) == min(fails + 2, CANDIDATES)


def test_no_answer_releases_before_the_bound_of_its_aspect():
    for place in ((1.3, 0.2, 0.0), (0.4, -0.9, 0.0), (-0.8, 0.6, 0.3)):
        problem = joint_problem(release=TargetRelease(np.array(place)))
        motion = plan(problem).trajectory
        k = motion.release_index
        least_s = least_times_to_aspects(problem)[aspects(problem.cell.robot, motion.q[k][None])[0]]
        assert motion.release_time_s >= least_s


def test_casadi_requested_by_name_uses_the_optimiser_alone():
    search = searched(target_problem(backend="casadi"))
    assert search.best is not None
    assert {attempt.backend for attempt in search.attempts} == {"casadi"}


def test_ruckig_answers_where_the_optimiser_gives_nothing(monkeypatch):
    def fails(*_):
        raise casadi_nlp.SeedFailed("made to fail", 1, False)

    monkeypatch.setattr(casadi_nlp, "solve", fails)
    answer = plan(target_problem())
    assert answer.backend == "ruckig"
    assert answer.certificate.valid
    assert "made to fail" in {attempt.result.split(": ")[-1] for attempt in answer.attempts}


def test_a_throw_to_a_place_beside_the_foot_is_answered():
    """The optimiser's first solutions fly through foot and base, and it finds none from there: a stop before helps."""
    problem = joint_problem(
        "ur5-sim",
        start=np.array([-1.142766225, -0.862043666, 1.010899005, -0.375453395, -0.236162646, -1.170259227]),
        release=TargetRelease(np.array([-0.029392673, -0.071290177, 0.0])),
        time_limit_s=60.0,
    )
    answer = plan(problem)
    assert answer.certificate.valid
    assert answer.trajectory.release_time_s < 1.2


def test_a_given_state_whose_soonest_arrival_is_not_certified_is_reached_all_the_same():
    """Tool speed couples the joints: Ruckig, which knows them one by one, breaks it."""
    limits = replace(cell().limits, tcp_speed_max=0.8)
    known = joint_problem().release
    assert isinstance(known, JointRelease)
    problem = joint_problem(limits=limits, release=JointRelease(known.q, 0.3 * known.qd))
    answer = plan(problem)
    assert answer.certificate.valid
    assert answer.trajectory.release_time_s < 1.0


BESIDE_THE_OPENING = joint_problem(
    cell=ideal_cell(),
    start=np.array([-1.148, -1.156, 0.301, -2.138, -0.279, -0.129]),
    release=TargetRelease(np.array([0.362, -0.627, 0.0])),
    time_limit_s=60.0,
)


def test_an_object_that_would_leave_beside_the_opening_leaves_through_it():
    search = searched(BESIDE_THE_OPENING)
    beside = [
        each.solution.trajectory.release_time_s
        for each in search.rejected
        if "opening_direction" in {check.name for check in each.certificate.failures}
    ]
    assert beside
    assert search.release_time_s < 1.1 * min(beside)


@pytest.mark.slow
@pytest.mark.parametrize("p_W", [[1.2, 0.3, 0.0], [1.3, 0.0, 0.0], [1.0, -0.5, 0.0], [0.9, 0.6, 0.2]])
def test_a_weak_gripper_throws_about_as_soon_as_with_a_release_window(p_W):
    """A window only takes motions away."""
    here = cell()
    weak = replace(here, gripper=replace(here.gripper, hold_acceleration_m_s2=np.array([12.0])))
    released = []
    for window_s, tolerance_m in ((0.0, 0.0), (0.005, 0.02)):
        problem = target_problem(cell=weak, release_window_s=window_s, landing_tolerance_m=tolerance_m)
        released.append(searched(replace(problem, release=TargetRelease(np.array(p_W)))).release_time_s)
    assert released[0] <= 1.05 * released[1] < np.inf


BESIDE_THE_FOOT = {"ur5-sim": [0.0181, -0.0847, 0.0], "ur10e-sim": [0.0875, 0.0688, 0.0]}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(BESIDE_THE_FOOT))
@pytest.mark.parametrize("window_s", [0.0, 0.02])
def test_a_throw_to_a_place_beside_the_foot_passes_it(name, window_s):
    """The optimiser's motion, not a slower one that misses the foot by chance."""
    here = cell(name) if window_s else steady_cell(name)
    window = {"release_window_s": window_s, "landing_tolerance_m": 0.005} if window_s else {}
    release = TargetRelease(np.array(BESIDE_THE_FOOT[name]))
    answer = plan(ThrowProblem(here, here.home, release, here.limits, time_limit_s=60.0, **window))
    assert answer.backend == "casadi"
    assert answer.certificate.valid


def test_an_arm_brakes_out_of_the_way_of_a_throw_back_over_it(monkeypatch):
    """With the shortest brake the object meets the arm at rest. Another release is later by half, or more."""
    start = np.array([0.21, -2.79, 0.51, -0.47, -2.42, 0.21])
    problem = joint_problem("ur5-sim", release=TargetRelease(np.array([0.761, -0.095, 0.0])), start=start)
    keeps_off = searched(problem).release_time_s
    groups_of = instance._applicable_groups
    without = lambda *of: tuple(group for group in groups_of(*of) if group != "passing")  # noqa: E731
    monkeypatch.setattr(instance, "_applicable_groups", without)
    assert keeps_off < 0.7 * searched(problem).release_time_s


@pytest.mark.parametrize("backend", MOTIONS)
def test_a_back_end_requested_by_name_answers_itself(backend):
    known = joint_problem().release
    assert isinstance(known, JointRelease)
    asked = pose_problem(cell(), known.q, known.qd)
    problem = joint_problem(release=asked.release, backend=backend)
    answer = plan(problem)
    assert answer.backend == backend
    assert [attempt.backend for attempt in answer.attempts] == [backend]
    assert certify(problem, answer.trajectory).valid


@pytest.mark.parametrize("backend", MOTIONS)
def test_its_nearest_request_is_feasible_for_it(backend):
    too_fast = JointRelease(cell().home + 0.3, np.array([3.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
    problem = joint_problem(release=too_fast, backend=backend)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    nearest = refusal.value.nearest
    assert nearest is not None
    assert nearest["backend"] == backend
    assert plan(problem_from_request(nearest, problem.cell)).certificate.valid


@pytest.mark.parametrize("bound", [{"max_elevation_rad": 1.5701}, {"min_elevation_rad": -1.5701}])
def test_an_elevation_close_to_the_vertical_is_hardly_a_bound(bound):
    """Its tangent is finite and huge; the release is as soon as without it."""
    free = plan(target_problem()).trajectory.release_time_s
    release = TargetRelease(np.array([1.3, 0.2, 0.0]), **bound)
    assert plan(joint_problem(release=release)).trajectory.release_time_s == pytest.approx(free, abs=0.005)
