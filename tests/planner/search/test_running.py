"""A retarget begins with what is left of the running throw: moved to the new target, or searched for anew."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from planner import planning
from planner.certificate import certify
from planner.planning import SearchHints, plan
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.search import way_home
from planner.trajectory import Trajectory
from tests.planner.problems import joint_problem

BEGIN = 40  # [ticks] of the running throw, which releases after about 120
LATER_S = 0.02  # [s] after the running throw's release: it was the soonest, and the new target is 4 cm off


@pytest.fixture(scope="module")
def left() -> Trajectory:
    """What is left of a throw."""
    return plan(at([1.2, 0.3, 0.0])).trajectory.since(BEGIN)


def at(target: list[float], **changes) -> ThrowProblem:
    return joint_problem(release=TargetRelease(np.array(target)), **changes)


def begun_on(left: Trajectory, problem: ThrowProblem) -> ThrowProblem:
    return replace(problem, start=left.q[0], start_qd=left.qd[0], start_qdd=left.qdd[0])


def tried(left: Trajectory, problem: ThrowProblem) -> list[str]:
    """What was tried, in words."""
    found = plan(problem, SearchHints(nearby=left, offers_nearest=False))
    return [f"{attempt.backend}: {attempt.result}" for attempt in found.attempts]


@pytest.mark.parametrize("target", [[1.24, 0.3, 0.0], [1.2, 0.26, 0.0], [1.16, 0.34, 0.0]])
def test_the_running_throw_goes_over_to_a_target_nearby(left: Trajectory, target: list[float]):
    problem = begun_on(left, at(target))
    found = plan(problem, SearchHints(nearby=left))
    assert [attempt.result for attempt in found.attempts] == ["moved throw: certified"]
    certificate = certify(problem, found.trajectory)
    assert certificate.valid
    assert certificate.check("join").ok
    assert found.trajectory.release_time_s < left.release_time_s + LATER_S
    way = found.way_home
    assert way.problem is not None and way.trajectory is not None
    assert certify(way.problem, way.trajectory).valid


def test_the_same_running_throw_has_the_same_answer_wherever_it_is_planned(left: Trajectory):
    problem = begun_on(left, at([1.24, 0.3, 0.0]))
    carried = pickle.loads(pickle.dumps(left))  # as to a planner process
    first, second = (plan(problem, SearchHints(nearby=each)).trajectory for each in (left, carried))
    assert np.array_equal(first.q, second.q)


def test_a_target_that_it_does_not_reach_is_searched_for_anew(left: Trajectory, monkeypatch):
    monkeypatch.setattr(planning, "MOVED_M", np.inf)
    problem = begun_on(left, at([-1.1, 0.2, 0.0]))
    found = plan(problem, SearchHints(nearby=left))
    first, *others = (attempt.result for attempt in found.attempts)
    assert first.startswith("moved throw: ")
    assert "certified" not in first
    assert others
    assert np.array_equal(found.trajectory.q, plan(problem).trajectory.q)


@pytest.mark.parametrize("target", [[-1.1, 0.2, 0.0], [1.2, 0.55, 0.0]])
def test_a_target_that_it_lands_far_from_is_searched_for_anew(left: Trajectory, target: list[float]):
    problem = begun_on(left, at(target))
    found = plan(problem, SearchHints(nearby=left))
    assert not any("moved throw" in attempt.result for attempt in found.attempts)
    assert np.array_equal(found.trajectory.q, plan(problem).trajectory.q)


@pytest.mark.parametrize(
    "problem",
    [at([1.24, 0.3, 0.0], backend="ruckig"), joint_problem(release=JointRelease(joint_problem().start, np.zeros(6)))],
    ids=["without the optimiser", "without a target"],
)
def test_what_the_throw_cannot_be_moved_to_is_planned_as_ever(left: Trajectory, problem: ThrowProblem):
    assert not any("moved throw" in each for each in tried(left, begun_on(left, problem)))


def test_a_throw_that_waits_or_is_about_to_let_go_is_not_moved(left: Trajectory):
    """What waits need not wait for the new target, and what lets go within the gripper's delay cannot be replaced."""
    whole = plan(at([1.2, 0.3, 0.0])).trajectory
    delay = round(joint_problem().cell.gripper.delay_s / whole.dt)
    late = whole.since(whole.release_index - delay)
    still = np.repeat(whole.q[:1], 600, axis=0)
    waits = Trajectory(
        whole.sample_rate_hz,
        np.concatenate([still, whole.q]),
        *(np.concatenate([0.0 * still, each]) for each in (whole.qd, whole.qdd)),
        release_index=600 + whole.release_index,
    )
    for running in (late, waits):
        assert not any("moved throw" in each for each in tried(running, begun_on(running, at([1.24, 0.3, 0.0]))))
    assert "casadi: moved throw: certified" in tried(left, begun_on(left, at([1.24, 0.3, 0.0])))


@pytest.mark.parametrize("before", [4, 8, 12])
def test_a_moved_throw_lets_go_once_it_can_be_joined(before: int):
    """The executor refuses to join a plan whose gripper would be told to open before it begins."""
    problem = at([1.2, 0.3, 0.0])
    slow = replace(problem.limits, qdd_max=0.5 * problem.limits.qdd_max)
    whole = plan(at([1.2, 0.3, 0.0], limits=slow)).trajectory
    delay = round(problem.cell.gripper.delay_s / whole.dt)
    running = whole.since(whole.release_index - delay - before)
    found = plan(begun_on(running, at([1.26, 0.24, 0.0])), SearchHints(nearby=running, offers_nearest=False))
    moved = [each.result for each in found.attempts] == ["moved throw: certified"]
    assert not moved or found.trajectory.release_index > delay


@pytest.mark.parametrize("bars", ["the first", "the sooner"])
def test_a_throw_that_leads_home_from_nowhere_is_not_the_last_word(left: Trajectory, monkeypatch, bars: str):
    """Where no way leads home from the end of the throw that was moved, others are searched for, later ones too."""
    problem = begun_on(left, at([1.24, 0.3, 0.0]))
    asked = []
    find = way_home.find_way_home

    def blocked(problem, motion, deadline_s):
        asked.append(motion.solution.trajectory.release_time_s)
        is_barred = len(asked) == 1 if bars == "the first" else asked[-1] <= asked[0]
        return (None, motion.examination.certificate.checks) if is_barred else find(problem, motion, deadline_s)

    monkeypatch.setattr(way_home, "find_way_home", blocked)
    words = tried(left, problem)
    assert words[0] == "casadi: moved throw: certified"
    assert any("TargetRelease" in each for each in words)
