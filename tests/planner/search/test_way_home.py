"""The way home from a plan's end: certified for what the tool holds there, and required of every plan."""

import time
from dataclasses import replace

import numpy as np
import pytest

from planner.approach.rest_to_rest import rest_to_rest_motion
from planner.backends.solution import Solution
from planner.cell import Cell
from planner.certificate import certify
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed
from planner.planning import plan
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.search import PlanningSearch, best_with_way_home, way_home
from tests.planner.problems import cell, joint_problem

THROW = joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])))
MOVE = joint_problem(release=JointRelease(cell().home + 0.3, np.zeros(6)))


@pytest.mark.parametrize("problem", [THROW, MOVE], ids=["throw", "move to rest"])
def test_it_leads_from_the_end_to_home_and_is_certified(problem: ThrowProblem) -> None:
    answer = plan(problem)
    way = answer.way_home
    home = problem.cell.home
    assert way.trajectory is not None and way.problem is not None
    np.testing.assert_allclose(way.trajectory.q[[0, -1]], [answer.trajectory.q[-1], home], atol=1e-9)
    assert certify(way.problem, way.trajectory).valid
    assert way.problem.holds_object == problem.ends_at_rest
    assert way.duration_s == way.trajectory.duration_s


def test_a_plan_that_ends_at_home_is_there() -> None:
    home = cell().home
    answer = plan(joint_problem(start=home + 0.2, release=JointRelease(home, np.zeros(6))))
    assert answer.way_home.duration_s == 0.0


def narrow(wide: Cell) -> Cell:
    """Returns the cell with a first joint that turns no farther than 0.5 rad from home."""
    lower = wide.limits.q_lower.copy()
    upper = wide.limits.q_upper.copy()
    lower[0] = wide.home[0] - 0.5
    upper[0] = wide.home[0] + 0.5
    return replace(wide, limits=replace(wide.limits, q_lower=lower, q_upper=upper))


def moves(*turns: float) -> PlanningSearch:
    """Returns a search with certified moves that turn the first joint: beyond 0.5 rad no way leads home."""
    wide = cell().limits
    here = narrow(cell())
    search = PlanningSearch(ThrowProblem(here, here.home, MOVE.release, wide), time.perf_counter() + 60.0)
    for turn in turns:
        end = here.home + turn * np.eye(6)[0]
        search.problem = ThrowProblem(here, here.home, JointRelease(end, np.zeros(6)), wide)
        motion = rest_to_rest_motion(np.array([here.home, end]), wide, search.problem.dt)
        assert search.certify("test", Solution(motion, "a move")).is_valid
    return search


def test_the_next_best_motion_is_taken_where_the_best_is_stuck() -> None:
    search = moves(0.6, 0.45, 0.7)
    motion, way = best_with_way_home(search)
    assert motion.solution.trajectory.q[-1, 0] == pytest.approx(cell().home[0] + 0.45)
    assert way.duration_s > 0.0


def test_where_no_motion_has_a_way_home_the_refusal_names_what_blocks_it() -> None:
    search = moves(0.7, 0.6)
    with pytest.raises(Infeasible) as refusal:
        best_with_way_home(search)
    (violation,) = refusal.value.violations
    assert violation.constraint == "way_home"
    assert violation.value == pytest.approx(cell().home[0] + 0.6)  # of the sooner one
    assert violation.limit == pytest.approx(cell().home[0] + 0.5)
    assert "shoulder_pan_joint" in violation.detail


@pytest.mark.parametrize(("turns", "was_cut_short"), [((0.7, 0.6), False), ((0.7,), True)])
def test_a_search_without_a_way_home_that_the_time_limit_ended_says_so(turns, was_cut_short) -> None:
    search = moves(*turns)
    search.deadline_s = 0.0
    search.was_cut_short = was_cut_short  # of two motions, the second is left untried
    with pytest.raises(SolverFailed) as failure:
        best_with_way_home(search)
    assert failure.value.status == TIME_LIMIT
    assert [violation.constraint for violation in failure.value.violations] == ["way_home"]


def test_a_finished_search_without_a_way_home_is_refused_after_its_time_limit_too() -> None:
    search = moves(0.7)
    search.deadline_s = 0.0
    with pytest.raises(Infeasible):
        best_with_way_home(search)


def test_a_search_for_a_way_home_that_its_deadline_ended_has_not_proven_that_there_is_none(monkeypatch) -> None:
    search = moves(0.7)
    clock = [0.0]
    deadlines = []
    find = way_home.find_approach

    def slow(*given, deadline_s, **named):
        deadlines.append(deadline_s)
        clock[0] = deadline_s
        return find(*given, deadline_s=deadline_s, **named)

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(way_home, "find_approach", slow)
    for limit_s in (100.0, 0.1):
        clock[0] = 0.0
        search.deadline_s = limit_s
        with pytest.raises(SolverFailed) as failure:
            best_with_way_home(search)
        assert failure.value.status == TIME_LIMIT
    assert deadlines == [100.0, way_home.LATE_S]


def test_a_plan_without_a_way_home_is_refused() -> None:
    here = narrow(cell())
    end = here.home + 0.6 * np.eye(6)[0]
    with pytest.raises(Infeasible) as refusal:
        plan(ThrowProblem(here, here.home, JointRelease(end, np.zeros(6)), cell().limits))
    assert [violation.constraint for violation in refusal.value.violations] == ["way_home"]
