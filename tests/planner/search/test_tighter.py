"""Answers under tighter limits: sought where a search is doubtful, and certified under the request's own."""

import time
from dataclasses import replace

import numpy as np
import pytest

from planner.backends import casadi_nlp
from planner.backends.casadi_nlp import SeedFailed
from planner.cell import Box
from planner.errors import Infeasible
from planner.planning import SearchHints, plan
from planner.problem import Opening, PointRelease, TargetRelease
from planner.search import PlanningSearch, Ranking, auto, nearest_problem, tighter
from planner.search.ranking import RankedCandidate
from planner.seeds import candidates
from planner.solution import Solution
from planner.trajectory import Trajectory
from tests.planner.problems import cell, joint_problem

TARGET = joint_problem(release=TargetRelease(np.array([1.6, 0.1, 0.0])))
NEAR = joint_problem(release=TargetRelease(np.array([0.8, 0.3, 0.0])))  # releases well before its candidates' bounds
POINT = joint_problem(release=PointRelease(np.array([-0.4, -0.4, 0.6]), np.array([-1.0, -1.0, 0.5])))
JERK = TARGET.limits.jerk_max


@pytest.fixture
def jerks(monkeypatch):
    """The share of the request's jerk that each solve was given; solves with all of it fail."""
    shares = []
    solve = casadi_nlp.solve

    def failing(problem, seed, options):
        shares.append(problem.limits.jerk_max[0] / JERK[0])
        if shares[-1] == 1.0:
            raise SeedFailed("made to fail", 1, frozenset(), False)
        return solve(problem, seed, options)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    return shares


@pytest.fixture
def searched(monkeypatch):
    """Every search that is made: its problem, the bounds of its candidates, and the rows that it begins with."""
    made = []
    search = tighter.search_optimised

    def noted(inner, ranking, *policy):
        made.append((inner.problem, [each.candidate.bound_s for each in ranking], inner.held))
        return search(inner, ranking, *policy)

    monkeypatch.setattr(tighter, "search_optimised", noted)
    return made


@pytest.fixture
def in_vain(monkeypatch):
    """The optimiser's motions are answers, and yet all their candidates are noted as having led to none."""

    def noted(search, ranked, _found):
        search.led_to_motion[ranked.candidate] = False

    monkeypatch.setattr(auto, "_note_outcome", noted)


def test_nothing_more_is_sought_where_the_soonest_arrival_is_certified(searched):
    assert plan(joint_problem()).backend == "ruckig"
    assert len(searched) == 1


def test_a_throw_that_is_found_with_half_the_jerk_alone_is_an_answer(jerks):
    answer = plan(TARGET)
    assert jerks[0] == 1.0
    assert 0.5 in jerks
    assert answer.backend == "casadi"
    assert answer.certificate.valid
    assert np.abs(answer.trajectory.jerk).max() <= 0.5 * JERK.max() * (1.0 + 1e-6)
    assert any("under tighter limits" in attempt.result for attempt in answer.attempts)


def test_the_answer_is_no_later_than_with_half_the_limits(jerks):
    answer = plan(TARGET)
    half = plan(replace(TARGET, limits=replace(TARGET.limits, jerk_max=0.5 * JERK)))
    assert answer.trajectory.release_time_s <= half.trajectory.release_time_s
    assert half.trajectory.release_time_s > 0.0


@pytest.mark.parametrize("is_slow", [False, True])
def test_a_search_is_repeated_where_its_answer_is_slow(in_vain, monkeypatch, is_slow):
    monkeypatch.setattr(Ranking, "is_slow", lambda *_: is_slow)
    answer = plan(TARGET)
    assert any("under tighter limits" in attempt.result for attempt in answer.attempts) is is_slow


def test_a_request_with_twice_the_jerk_is_searched_as_this_one_too(searched, monkeypatch):
    """Of a search without an answer the one under half the jerk has the same candidates as a request's own."""

    def failing(*_):
        raise SeedFailed("made to fail", 1, frozenset(), False)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    alone = replace(TARGET, backend="casadi")
    with pytest.raises(Infeasible):
        plan(alone, SearchHints(offers_nearest=False))
    (own, bounds, _), *_ = searched
    searched.clear()
    with pytest.raises(Infeasible):
        plan(replace(alone, limits=replace(TARGET.limits, jerk_max=2.0 * JERK)), SearchHints(offers_nearest=False))
    assert any(
        np.array_equal(problem.limits.jerk_max, own.limits.jerk_max) and found == bounds
        for problem, found, _ in searched[1:]
    )


def test_a_slower_arrival_is_an_answer_where_the_soonest_is_none(jerks, monkeypatch):
    """As past a post that the soonest motion to the same state meets: stood for by a certificate of another problem."""
    problem = joint_problem()
    certified = auto.certified
    elsewhere = replace(problem, start=problem.start + 0.1)

    def rejecting(backend, asked, solution):
        own = asked.limits.jerk_max[0] == JERK[0] and asked.limits.qdd_max[0] == problem.limits.qdd_max[0]
        return certified(backend, elsewhere if own else asked, solution)

    soonest = plan(problem)
    monkeypatch.setattr(auto, "certified", rejecting)
    answer = plan(problem)
    assert any("slower arrivals" in attempt.result for attempt in answer.attempts)
    assert answer.backend == "ruckig"
    assert answer.certificate.valid
    assert soonest.trajectory.release_time_s < answer.trajectory.release_time_s
    assert 1.0 in jerks


@pytest.mark.parametrize(("jerk", "count"), [(0.5, 2), (1.0, 2), (2.0, 3), (4.0, 4), (1000.0, 5), (np.inf, 5)])
def test_the_more_jerk_a_request_allows_the_more_often_it_is_halved(jerk, count):
    limits = replace(TARGET.limits, jerk_max=jerk * JERK)  # 500 rad/s^3 times `jerk`, with 15 rad/s^2: 30 ms / `jerk`
    halvings = tighter._halvings(limits)
    assert [k for k, acceleration in halvings if acceleration == 0] == list(range(1, count + 1))
    assert [k for k, acceleration in halvings if acceleration == 1] == [0]


def test_one_joint_of_little_acceleration_does_not_multiply_the_searches():
    qdd_max = np.append(TARGET.limits.qdd_max[:5], 1e-6)
    assert tighter._halvings(replace(TARGET.limits, qdd_max=qdd_max)) == tighter._halvings(TARGET.limits)


def test_torque_is_held_where_nothing_was_optimised_and_the_joints_are_free(in_vain, searched, monkeypatch):
    monkeypatch.setattr(tighter, "is_doubtful", lambda *_: True)
    for answered in (POINT, TARGET):
        plan(answered)
    assert tighter.TORQUE not in [held for _, _, held in searched]
    searched.clear()

    def failing(*_):
        raise SeedFailed("made to fail", 1, frozenset(), False)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    plan(POINT)
    assert searched[1][2] == tighter.TORQUE
    searched.clear()
    monkeypatch.setattr(PlanningSearch, "is_optimal", False)
    plan(joint_problem())
    assert len(searched) > 2
    assert tighter.TORQUE not in [held for _, _, held in searched]


def test_where_there_is_an_answer_a_search_is_repeated_from_what_led_to_none(searched, monkeypatch):
    monkeypatch.setattr(Ranking, "is_slow", lambda *_: True)
    solve = casadi_nlp.solve
    failed = []

    def failing_first(problem, seed, options):
        if len(failed) < 2:  # from both guesses
            failed.append(seed.candidate)
            raise SeedFailed("made to fail", 1, frozenset(), False)
        return solve(problem, seed, options)

    monkeypatch.setattr(casadi_nlp, "solve", failing_first)
    assert plan(TARGET).certificate.valid
    assert failed[0] is failed[1]
    own, *repeats = [bounds for _, bounds, _ in searched][:3]
    assert len(own) > 1
    assert repeats == [[failed[0].bound_s]] * 2


def test_nothing_is_repeated_where_every_candidate_led_to_a_motion(searched, monkeypatch):
    monkeypatch.setattr(Ranking, "is_slow", lambda *_: True)
    plan(TARGET)
    assert len(searched) == 2  # the request's own, and the second solver


def test_a_candidate_whose_motion_is_found_by_another_seed_is_not_in_vain():
    search = PlanningSearch(NEAR, time.perf_counter() + 60.0)
    found = candidates(NEAR)[:2]
    first, second = Ranking(NEAR, found)
    auto._note_outcome(search, first, False)
    auto._note_outcome(search, second, True)
    assert list(search.in_vain) == [first.candidate]
    auto._note_outcome(search, first, True)
    auto._note_outcome(search, second, False)
    assert not search.in_vain
    auto._note_outcome(search, RankedCandidate(NEAR, found[0], plan(NEAR).trajectory), False)  # of another problem
    assert not search.in_vain


@pytest.mark.parametrize(
    ("release", "window_s", "share", "ramp_s"),
    [
        (TARGET.release, 0.0, 1.05, 0.03),
        (TARGET.release, 0.005, 1.4, 0.03),
        (joint_problem().release, 0.0, 1.05, 0.0),
        (POINT.release, 0.0, 1.15, 0.0),
    ],
)
def test_an_answer_is_slow_beyond_a_share_of_the_least_bound(release, window_s, share, ramp_s):
    """A throw to a target may take as long in addition as its acceleration takes to the limit: 15 at 500 rad/s^3."""
    problem = replace(TARGET, release=release, release_window_s=window_s, landing_tolerance_m=0.02 if window_s else 0.0)
    found = candidates(problem)
    ranking = Ranking(problem, found)
    least_s = min(candidate.bound_s for candidate in found)
    assert not ranking.is_slow(0.999 * share * least_s + ramp_s)
    assert ranking.is_slow(1.001 * share * least_s + ramp_s)
    assert ranking.is_slow(np.inf)


BIN = TargetRelease(np.array([-1.38243632, 0.16769024, 0.05536662]), opening=Opening(0.12194, 0.35658))
WALL = Box(np.array([-0.73686, -0.27345, 0.0]), np.array([-0.62197, 0.82058, 0.38351]))


def test_a_window_is_kept_from_the_motion_without_it(monkeypatch):
    """Where the optimiser fails from Ruckig's motions: of 600 targets behind walls and in bins none is such by now."""
    solve = casadi_nlp.solve

    def failing(problem, seed, options):
        if problem.is_robust and not isinstance(seed.initial_guess, Trajectory):
            raise SeedFailed("made to fail", 1, frozenset(), False)
        return solve(problem, seed, options)

    monkeypatch.setattr(casadi_nlp, "solve", failing)
    here = cell()
    walled = replace(here, surroundings=replace(here.surroundings, keep_out=(WALL,)))
    problem = joint_problem(cell=walled, release=BIN, release_window_s=0.005, landing_tolerance_m=0.10194)
    answer = plan(problem)
    assert answer.certificate.valid
    assert any("from motions without the window: 1 of 1" in attempt.result for attempt in answer.attempts)


def test_a_motion_without_the_window_that_keeps_it_is_an_answer(monkeypatch):
    monkeypatch.setattr(tighter, "FROM_NOMINAL_POLICY", ())
    search = PlanningSearch(
        replace(TARGET, release_window_s=0.001, landing_tolerance_m=0.2), time.perf_counter() + 60.0
    )
    tighter.search_from_nominal(search)
    assert search.answer is not None
    assert search.answer.is_valid


def test_where_no_motion_keeps_the_window_the_one_without_it_is_nearest():
    problem = replace(TARGET, release_window_s=0.2, landing_tolerance_m=0.002)
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    tighter.search_from_nominal(search)
    assert search.incumbent is None
    in_the_way = {each.constraint for each in search.violations()}
    of_window = {"flight_clearance", "opening_direction"}
    assert "landing_window" in in_the_way <= {"landing_window", *of_window}
    nearest = nearest_problem(search, [])
    assert nearest is not None
    assert nearest.release is problem.release
    assert nearest.release_window_s < 0.2
    assert plan(nearest).certificate.valid


@pytest.mark.parametrize(("window_s", "times"), [(0.005, 2), (0.0, 1)])
def test_further_seeds_of_a_repeated_search_come_after_the_first_of_every_way(
    in_vain, searched, monkeypatch, window_s, times
):
    """And only where an answer with a release window is slow: then all ways are searched twice, else once."""
    monkeypatch.setattr(Ranking, "is_slow", lambda *_: True)
    plan(replace(NEAR, release_window_s=window_s, landing_tolerance_m=0.02 if window_s else 0.0))
    repeats = _ways(searched)[1 : 1 + 2 * times]  # half of the jerk, a quarter
    assert len(set(repeats[:2])) == 2
    assert repeats[2:] == repeats[:2] * (times - 1)
    assert len(_ways(searched)) == 2 + 2 * times  # and the request's own, and the second solver


@pytest.mark.parametrize(("problem", "shares"), [(NEAR, [0.5, 0.25]), (POINT, [0.5])])
def test_of_a_request_with_an_answer_the_jerk_alone_is_halved(in_vain, searched, monkeypatch, problem, shares):
    monkeypatch.setattr(tighter, "is_doubtful", lambda *_: True)
    plan(replace(problem, limits=replace(problem.limits, jerk_max=2.0 * JERK)))
    own, *repeats, last = _ways(searched)
    assert own == last
    assert [jerk[0] / own[0][0] for jerk, _, _ in repeats] == shares
    assert {(acceleration, held) for _, acceleration, held in repeats} == {own[1:]}


def test_of_a_given_release_with_an_answer_the_jerk_is_halved_once():
    problem = joint_problem()
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search.consider(auto.certified("casadi", problem, Solution(plan(problem).trajectory, "made before")))
    search.has_optimised = True
    (way,) = tighter._ways(search)
    assert way.problem.limits.jerk_max.tolist() == (problem.limits.jerk_max / 2.0).tolist()
    assert way.problem.limits.qdd_max.tolist() == problem.limits.qdd_max.tolist()
    search.has_optimised = False
    assert len(tighter._ways(search)) > 2


def test_a_throw_of_which_a_seed_was_given_up_is_in_doubt():
    search = PlanningSearch(NEAR, time.perf_counter() + 60.0)
    search.consider(auto.certified("casadi", NEAR, Solution(plan(NEAR).trajectory, "made before")))
    ranking = Ranking(NEAR, candidates(NEAR))
    ranking._least_bounds = {0: search.release_time_s / 1.16}
    assert not tighter.is_doubtful(search, ranking)
    search.given_up = 1
    search.led_to_motion[ranking[0].candidate] = False
    assert tighter.is_doubtful(search, ranking)
    ranking._least_bounds = {0: search.release_time_s / 1.14}  # too little to gain
    assert not tighter.is_doubtful(search, ranking)


def test_a_slower_motion_is_an_answer_where_the_optimiser_alone_has_one(jerks, monkeypatch):
    """Where the motions to a state with the request's own jerk are rejected, and soonest arrivals of all."""
    problem = joint_problem()
    certified = auto.certified
    elsewhere = replace(problem, start=problem.start + 0.1)

    def rejecting(backend, asked, solution):
        own = asked.limits.jerk_max[0] == JERK[0] and backend == "ruckig"
        return certified(backend, elsewhere if own else asked, solution)

    late = Solution(plan(replace(problem, limits=tighter._halved(problem.limits, 4, 2))).trajectory, "late")
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search.consider(certified("casadi", problem, late))
    assert search.incumbent is not None
    monkeypatch.setattr(auto, "certified", rejecting)
    tighter.search_sooner(search, candidates(problem))
    assert search.incumbent.backend == "ruckig"
    assert search.release_time_s < late.trajectory.release_time_s
    assert np.abs(search.incumbent.solution.trajectory.jerk).max() <= 0.5 * JERK.max() * (1.0 + 1e-6)


def test_slower_motions_follow_the_optimiser_where_a_state_is_given(searched, monkeypatch):
    policies = []
    search = tighter.search_optimised
    monkeypatch.setattr(tighter, "search_optimised", lambda *given: policies.append(given[2:]) or search(*given))
    monkeypatch.setattr(PlanningSearch, "is_optimal", False)
    plan(joint_problem())
    assert policies.count((tighter.SOONER_POLICY,)) == len(tighter.SOONER_HALVINGS)
    policies.clear()
    plan(NEAR)
    assert (tighter.SOONER_POLICY,) not in policies


def _ways(searched):
    """Limits on jerk and acceleration of each search that was made, and the rows that it began with."""
    return [(tuple(problem.limits.jerk_max), tuple(problem.limits.qdd_max), held) for problem, _, held in searched]
