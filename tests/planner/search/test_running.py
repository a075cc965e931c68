"""A retarget begins with what is left of the running throw: moved to the new target, or searched for anew."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

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
    found = plan(problem, SearchHints(running=left, offers_nearest=False))
    return [f"{attempt.backend}: {attempt.result}" for attempt in found.attempts]


@pytest.mark.parametrize("target", [[1.24, 0.3, 0.0], [1.2, 0.26, 0.0], [1.16, 0.34, 0.0]])
def test_the_running_throw_goes_over_to_a_target_nearby(left: Trajectory, target: list[float]):
    problem = begun_on(left, at(target))
    found = plan(problem, SearchHints(running=left))
    assert [attempt.result for attempt in found.attempts] == ["running motion: certified"]
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
    first, second = (plan(problem, SearchHints(running=each)).trajectory for each in (left, carried))
    assert np.array_equal(first.q, second.q)


def test_a_target_that_it_does_not_reach_is_searched_for_anew(left: Trajectory):
    problem = begun_on(left, at([-1.1, 0.2, 0.0]))
    found = plan(problem, SearchHints(running=left))
    first, *others = (attempt.result for attempt in found.attempts)
    assert first.startswith("running motion: ")
    assert "certified" not in first
    assert others
    assert np.array_equal(found.trajectory.q, plan(problem).trajectory.q)


@pytest.mark.parametrize(
    "problem",
    [at([1.24, 0.3, 0.0], backend="ruckig"), joint_problem(release=JointRelease(joint_problem().start, np.zeros(6)))],
    ids=["without the optimiser", "without a target"],
)
def test_what_the_throw_cannot_be_moved_to_is_planned_as_ever(left: Trajectory, problem: ThrowProblem):
    assert not any("running motion" in each for each in tried(left, begun_on(left, problem)))


def test_a_throw_that_leads_home_from_nowhere_is_not_the_last_word(left: Trajectory, monkeypatch):
    """Where no way leads home from the end of the throw that was moved, others are searched for."""
    problem = begun_on(left, at([1.24, 0.3, 0.0]))
    asked = []
    find = way_home.find_way_home

    def blocked_at_first(problem, motion, deadline_s):
        asked.append(motion)
        return find(problem, motion, deadline_s) if len(asked) > 1 else (None, motion.examination.certificate.checks)

    monkeypatch.setattr(way_home, "find_way_home", blocked_at_first)
    words = tried(left, problem)
    assert words[0] == "casadi: running motion: certified"
    assert any("TargetRelease" in each for each in words)
