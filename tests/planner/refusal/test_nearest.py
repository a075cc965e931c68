"""The nearest feasible request: what is offered can be planned, is near, and is found within a number of searches."""

import itertools
import math
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from planner.problem import TIME_LIMIT_S, JointRelease, Opening, PointRelease, TargetRelease, ThrowProblem
from planner.refusal import nearest, nearest_problem
from planner.request import problem_from_request, request_document
from planner.search import PlanningSearch
from tests.planner.problems import cell, joint_problem, steady_cell, with_boxes

TARGET = joint_problem(
    release=TargetRelease(np.array([1.2, 0.3, 0.0])), release_window_s=0.01, landing_tolerance_m=0.02
)
FAR = TargetRelease(np.array([3.0, 0.0, 0.0]))
WINDOW = {"release_window_s": 0.005, "landing_tolerance_m": 0.02}


def refused(problem: ThrowProblem) -> PlanningSearch:
    """A search without an answer, with time left."""
    return PlanningSearch(problem, deadline_s=math.inf)


def offered(problem: ThrowProblem) -> ThrowProblem:
    """What the refusal of a problem offers, which is planned."""
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.nearest is not None
    found = problem_from_request(refusal.value.nearest, problem.cell)
    assert plan(found).certificate.valid
    return found


def answering(monkeypatch: pytest.MonkeyPatch, is_answered) -> list[ThrowProblem]:
    """Has the rule decide which problems have an answer; returns the list of those that were asked for."""
    asked = []

    def has(_, problem):
        asked.append(problem)
        return is_answered(problem)

    monkeypatch.setattr(nearest._Answers, "has", has)
    return asked


@pytest.mark.slow
def test_the_nearest_target_of_one_just_behind_a_wall_is_farther_behind_it():
    """No flight over the wall is as steep; before the wall the next target is as far away."""
    here = with_boxes(cell(), ([0.75, -1.0, 0.0], [0.8, 1.0, 0.7]))
    problem = joint_problem(cell=here, release=TargetRelease(np.array([0.83, 0.0, 0.0])), **WINDOW)
    found = offered(problem)
    assert found.release_window_s == problem.release_window_s
    assert found.release.p_W[1:] == pytest.approx([0.0, 0.0])
    assert 0.83 < found.release.p_W[0] <= 0.93


@pytest.mark.slow
@pytest.mark.parametrize(
    ("box", "asked", "direction", "at_most_m"),
    [  # each leaves room on one side alone
        (([1.1, -0.5, 0.0], [1.4, 0.02, 0.5]), [1.2, 0.0, 0.0], [0.0, 1.0, 0.0], 0.05),
        (([1.1, -0.02, 0.0], [1.4, 0.5, 0.5]), [1.2, 0.0, 0.0], [0.0, -1.0, 0.0], 0.05),
        (([0.6, -1.0, 0.52], [2.0, 1.0, 0.55]), [1.2, 0.0, 0.5], [0.0, 0.0, -1.0], 0.07),  # the flight's clearance, too
        (([0.8, -0.5, 0.0], [1.6, 0.5, 0.4]), [1.2, 0.3, 0.39], [0.0, 0.0, 1.0], 0.01),
    ],
)
def test_the_nearest_target_is_beside_below_or_on_top_of_what_is_in_the_way(box, asked, direction, at_most_m):
    """Of a gripper that opens in time: what opens late needs more room beside a box."""
    found = offered(joint_problem(cell=with_boxes(steady_cell(), box), release=TargetRelease(np.array(asked))))
    apart = found.release.p_W - asked
    assert 0.0 < np.linalg.norm(apart) <= at_most_m + 1e-9
    assert apart / np.linalg.norm(apart) == pytest.approx(direction)


def test_the_nearest_throw_keeps_its_target_where_its_release_position_is_in_a_box():
    here = with_boxes(cell(), ([0.3, -0.2, 0.5], [0.5, 0.2, 0.9]))
    release = TargetRelease(np.array([1.2, 0.3, 0.0]), release_position=np.array([0.4, 0.0, 0.7]))
    found = offered(joint_problem(cell=here, release=release, **WINDOW))
    assert found.release.release_position is None
    assert found.release.p_W == pytest.approx(release.p_W)
    assert found.release_window_s == 0.005


def test_the_nearest_target_of_one_below_the_floor_is_on_it_with_the_whole_release_window():
    found = offered(joint_problem(release=TargetRelease(np.array([1.2, 0.3, -0.2])), **WINDOW))
    assert found.release.p_W == pytest.approx([1.2, 0.3, 0.0])
    assert found.release_window_s == 0.005


@pytest.mark.slow
def test_the_nearest_target_of_one_out_of_range_keeps_the_release_window():
    problem = joint_problem(release=FAR, **WINDOW)
    found = nearest_problem(refused(problem))
    assert found is not None
    assert found.release_window_s == problem.release_window_s
    assert found.release.p_W[0] > 1.9


@pytest.mark.slow
def test_a_bin_out_of_range_is_offered_as_a_bin():
    problem = joint_problem(release=TargetRelease(np.array([2.4, 0.0, 0.0]), opening=Opening(0.1, 0.3)), **WINDOW)
    found = offered(problem)
    assert found.release.opening == problem.release.opening
    assert found.release.p_W[0] > 1.2


@pytest.mark.slow
def test_a_window_that_is_too_long_is_shortened_and_the_release_kept():
    # Ruckig's motions do not bend to the window, so its largest one is far below what is asked for.
    problem = replace(TARGET, release_window_s=0.02, landing_tolerance_m=0.005, backend="ruckig")
    found = offered(problem)
    assert found.release.p_W == pytest.approx(problem.release.p_W)
    assert 0.0 < found.release_window_s < 0.02
    assert found.release_window_s == pytest.approx(round(found.release_window_s, 4), abs=1e-12)


@pytest.mark.slow
def test_where_no_motion_keeps_the_window_the_release_is_kept_without_it():
    release = TargetRelease(np.array([1.6, 0.1, 0.0]))
    problem = joint_problem(release=release, release_window_s=0.2, landing_tolerance_m=0.002)
    found = nearest_problem(refused(problem))
    assert found is not None
    assert found.release is problem.release
    assert found.release_window_s < 0.2
    assert plan(found).certificate.valid


@pytest.mark.parametrize("longest_s", [0.0099, 0.0081, 0.004, 0.001, 0.0])
def test_as_much_of_the_window_is_offered_as_bisection_finds(monkeypatch, longest_s):
    asked = answering(monkeypatch, lambda problem: problem.release_window_s <= longest_s)
    found = nearest_problem(refused(TARGET))
    assert found is not None
    assert found.release is TARGET.release
    least_step_s = TARGET.release_window_s / 2**nearest.BISECTIONS + nearest.WINDOW_GRID_S
    assert longest_s - least_step_s <= found.release_window_s <= longest_s
    assert found.release_window_s == max(p.release_window_s for p in asked if p.release_window_s <= longest_s)


@pytest.mark.parametrize("farthest_m", [2.1, 1.7, 1.2])
def test_the_nearest_target_is_found_by_bisection(monkeypatch, farthest_m):
    answering(monkeypatch, lambda problem: problem.release.p_W[0] <= farthest_m)
    problem = joint_problem(release=FAR)
    found = nearest_problem(refused(problem))
    assert found is not None
    assert farthest_m - 3.0 / 2**nearest.BISECTIONS <= found.release.p_W[0] <= farthest_m


def test_the_window_is_given_up_where_no_easier_release_keeps_it(monkeypatch):
    answering(monkeypatch, lambda problem: not problem.is_robust and problem.release.p_W[0] <= 1.5)
    found = nearest_problem(refused(joint_problem(release=FAR, **WINDOW)))
    assert found is not None
    assert found.release_window_s == 0.0
    assert 1.4 <= found.release.p_W[0] <= 1.5


def test_nothing_is_offered_where_nothing_has_an_answer(monkeypatch):
    asked = answering(monkeypatch, lambda _: False)
    assert nearest_problem(refused(TARGET)) is None
    assert asked


@pytest.mark.parametrize(
    ("deadline_s", "budget"), [(math.inf, nearest.SEARCHES_MAX), (-math.inf, nearest.LATE_SEARCHES_MAX)]
)
def test_the_number_of_searches_is_bounded_and_smaller_after_the_deadline(monkeypatch, deadline_s, budget):
    searches = []
    monkeypatch.setattr(nearest, "search_candidates", lambda search, *_: searches.append(search))
    walled = with_boxes(cell(), ([1.3, -1.0, 0.0], [1.35, 1.0, 0.3]))  # with ways past the wall to try
    release = TargetRelease(np.array([1.2, 0.3, 0.0]), release_position=np.array([0.4, 0.0, 0.7]))
    problem = joint_problem(cell=walled, release=release, **WINDOW)
    assert nearest_problem(PlanningSearch(problem, deadline_s)) is None
    assert len(searches) == budget


def test_the_time_for_an_offer_is_bounded(monkeypatch):
    """An offer took up to 90 s beyond a time limit of 25 s where other processes were busy."""
    clock = [100.0]
    deadlines = []

    def slow(search, found, at_most):
        deadlines.append(search.deadline_s)
        clock[0] += 0.6 * nearest.LATE_S

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(nearest, "search_candidates", slow)
    problem = joint_problem(release=FAR)
    assert nearest_problem(PlanningSearch(problem, 90.0)) is None
    assert deadlines == [100.0 + nearest.LATE_S] * 2
    deadlines.clear()
    assert nearest_problem(PlanningSearch(problem, 1000.0)) is None
    assert set(deadlines) == {1000.0}


def test_a_move_to_rest_is_offered_as_one():
    q = cell().home + 5.0 * np.eye(6)[2]
    found = offered(joint_problem(release=JointRelease(q, np.zeros(6))))
    assert found.ends_at_rest


@pytest.mark.parametrize(("taken_s", "limit_s"), [(0.0, 0.5), (0.6, TIME_LIMIT_S)])
def test_an_offer_has_another_time_limit_where_the_requests_was_too_short(monkeypatch, taken_s, limit_s):
    """A limit that passed before the offer was found would end the search for its plan, too."""
    problem = joint_problem(release=FAR, time_limit_s=0.5)
    clock = [0.0]

    def slow(search):
        found = nearest_problem(search)
        clock[0] += taken_s
        return found

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(sys.modules["planner.planning"], "nearest_problem", slow)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.nearest["time_limit_s"] == limit_s
    said = [attempt["result"] for attempt in refusal.value.attempts if attempt["backend"] == "nearest"]
    assert said == (["time_limit_s passed before every nearer request was tried"] if taken_s > 0.5 else [])


@pytest.mark.parametrize("window", [{}, WINDOW])
def test_a_request_that_its_time_limit_ended_is_offered_more_time(window):
    """Not with less of its window, nor with another release."""
    problem = joint_problem(release=TargetRelease(np.array([1.2, 0.3, 0.0])), time_limit_s=1e-3, **window)
    with pytest.raises(SolverFailed) as refusal:
        plan(problem)
    assert refusal.value.nearest == request_document(replace(problem, time_limit_s=TIME_LIMIT_S), problem.release)


def test_a_slow_clock_does_not_change_the_nearest_request(monkeypatch):
    problem = joint_problem(release=PointRelease(np.array([1.6, 0.2, 0.4]), np.array([0.5, 0.0, 0.5])))
    found = []
    ticks = itertools.count()
    for clock in (time.perf_counter, lambda: 0.01 * next(ticks)):
        monkeypatch.setattr(time, "perf_counter", clock)
        with pytest.raises(Infeasible) as refusal:
            plan(problem)
        found.append(refusal.value.nearest)
    assert found[0] is not None
    assert found[0] == found[1]
