"""plan(): random releases, refusals with the nearest thing that can be done, determinism."""

from dataclasses import replace

import numpy as np
import pytest

from planner.certificate import certify
from planner.document import problem_from_request
from planner.errors import Infeasible
from planner.planning import plan
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease
from tests.planner.problems import cell, feasible_states, joint_problem, pose_problem

RANDOM_POSES = 500


def test_every_random_feasible_pose_is_planned_and_certified():
    for known, motion in feasible_states(cell(), RANDOM_POSES, seed=21):
        problem = replace(pose_problem(cell(), known.release.q, known.release.qd), backend="ruckig")
        answer = plan(problem)
        assert answer.certificate.valid
        assert certify(problem, answer.trajectory).valid
        assert answer.trajectory.release_time_s <= motion.release_time_s + 1e-9
        assert answer.backend == "ruckig"


def test_a_move_that_ends_at_rest_has_an_empty_brake():
    problem = joint_problem(release=JointRelease(cell().home + 0.3, np.zeros(6)))
    answer = plan(problem).trajectory
    assert answer.release_index == len(answer.q) - 1
    np.testing.assert_allclose(answer.q[-1], cell().home + 0.3)


def test_the_same_request_has_the_same_plan():
    problem = joint_problem(release=TargetRelease(np.array([1.4, 0.4, 0.0])))
    first, second = plan(problem), plan(problem)
    np.testing.assert_array_equal(first.trajectory.q, second.trajectory.q)
    assert first.certificate == second.certificate


@pytest.mark.parametrize(
    "release",
    [
        PointRelease(np.array([0.5, 0.2, 0.5]), np.array([6.0, 0.0, 2.0])),
        PointRelease(np.array([2.0, 0.2, 0.5]), np.array([0.3, 0.0, 0.2])),
        JointRelease(cell().home + 0.3, np.array([3.5, 0.0, 0.0, 0.0, 0.0, 0.0])),
        TargetRelease(np.array([9.0, 0.0, 0.0])),
    ],
    ids=["too fast", "too far", "joint too fast", "target too far"],
)
def test_a_refusal_offers_something_that_certifies(release):
    problem = joint_problem(release=release)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.violations
    assert refusal.value.nearest is not None
    assert plan(problem_from_request(refusal.value.nearest, problem.cell)).certificate.valid


def test_a_pose_below_the_floor_names_the_floor():
    X = np.eye(4)
    X[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X[:3, 3] = [0.5, 0.1, -0.15]
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(release=PoseRelease(X, np.array([0.1, 0, 0, 0, 0, 0]))))
    assert any(v.constraint == "floor" for v in refusal.value.violations)
    assert all(v.value < v.limit for v in refusal.value.violations if v.constraint == "floor")


def test_the_story_is_told():
    answer = plan(joint_problem())
    assert answer.attempts
    assert {attempt.backend for attempt in answer.attempts} <= {"casadi", "ruckig"}
    assert any("certified" in attempt.result for attempt in answer.attempts)
    assert answer.solve_time_s > 0.0
