"""plan(): random releases, refusals with the nearest feasible request, determinism."""

from dataclasses import replace

import numpy as np
import pytest

from planner.answer import aimed_problem
from planner.certificate import certify
from planner.errors import Infeasible
from planner.planning import plan
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease
from planner.request import problem_from_request
from tests.planner.problems import cell, feasible_states, joint_problem, pose_problem

RANDOM_POSES = 200


@pytest.mark.slow
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
    first = plan(problem)
    second = plan(problem)
    np.testing.assert_array_equal(first.trajectory.q, second.trajectory.q)
    assert first.certificate == second.certificate


FAR_POSE = PoseRelease(np.eye(4) + 2.0 * np.eye(4, k=3), np.array([0.5, -0.6, 0.7, 0.0, 0.0, 0.0]))
REFUSED = {
    "point too fast": ("ur5e-sim", {"release": PointRelease(np.array([0.5, 0.2, 0.5]), np.array([6.0, 0.0, 2.0]))}),
    "point too far": ("ur10e-sim", {"release": PointRelease(np.array([3.0, 0.2, 0.5]), np.array([0.8, 0.5, 0.6]))}),
    "joint too fast": ("ur5e-sim", {"release": JointRelease(cell().home + 0.3, 3.5 * np.eye(6)[0])}),
    "joint outside its range": ("ur5e-sim", {"release": JointRelease(cell().home + 5.0 * np.eye(6)[2], np.ones(6))}),
    "pose too far, UR3e": ("ur3e-sim", {"release": FAR_POSE}),
    "pose too far, UR10e": ("ur10e-sim", {"release": FAR_POSE}),
    "pose too fast": ("ur5-sim", {"release": PoseRelease(np.eye(4) + 0.4 * np.eye(4, k=3), np.full(6, 4.0))}),
    "target too far": ("ur5e-sim", {"release": TargetRelease(np.array([9.0, 0.0, 0.0]))}),
    "target too far from its place": (
        "ur10e-sim",
        {"release": TargetRelease(np.array([9.0, 1.0, 0.0]), release_position=np.array([0.4, 0.2, 0.4]))},
    ),
    "robust target too far": (
        "ur5e-sim",
        {"release": TargetRelease(9.0 * np.eye(3)[0]), "release_window_s": 0.02, "landing_tolerance_m": 0.01},
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_offers_something_that_certifies(case):
    arm, changes = REFUSED[case]
    problem = joint_problem(arm, **changes)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.violations
    assert refusal.value.nearest is not None
    nearest = problem_from_request(refusal.value.nearest, problem.cell)
    assert nearest.is_robust or not problem.is_robust
    assert plan(nearest).certificate.valid


def test_the_nearest_place_is_at_the_edge_of_what_the_arm_reaches():
    asked = np.array([3.0, 0.3, 0.5])
    problem = joint_problem(release=PointRelease(asked, np.array([0.0, 0.3, 0.3])))
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.nearest is not None
    found = refusal.value.nearest["release"]
    np.testing.assert_allclose(found["velocity"], [0.0, 0.3, 0.3])
    shoulder = np.array([0.0, 0.0, problem.cell.robot.d[0]])
    assert 0.75 < np.linalg.norm(np.array(found["position"]) - shoulder) < 1.35
    assert np.dot(found["position"], asked) / np.linalg.norm(asked) > 0.7


# The arm throws about 2 m in any direction; what the first candidates reach depends on chance.
@pytest.mark.parametrize("target", [[6.0, 6.0, 0.0], [2.07, -1.87, 0.0], [-3.33, 0.55, 0.4]], ids=str)
def test_the_nearest_target_is_in_the_direction_asked_for_and_far(target):
    problem = joint_problem(release=TargetRelease(np.array(target)))
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert refusal.value.nearest is not None
    x, y, z = refusal.value.nearest["release"]["position"]
    assert z == target[2]
    assert (y / x, np.sign(x)) == (pytest.approx(target[1] / target[0]), np.sign(target[0]))
    assert np.hypot(x, y) > 1.75


def test_a_pose_below_the_floor_names_the_floor():
    X = np.eye(4)
    X[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X[:3, 3] = [0.5, 0.1, -0.15]
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(release=PoseRelease(X, np.array([0.1, 0, 0, 0, 0, 0]))))
    assert any(v.constraint == "floor" for v in refusal.value.violations)
    assert all(v.value < v.limit for v in refusal.value.violations if v.constraint == "floor")


def test_a_plan_carries_the_log_of_its_attempts():
    answer = plan(joint_problem())
    assert answer.attempts
    assert {attempt.backend for attempt in answer.attempts} <= {"casadi", "ruckig"}
    assert any("certified" in attempt.result for attempt in answer.attempts)
    assert answer.solve_time_s > 0.0


def test_the_arm_keeps_out_of_a_bin_where_it_stands_wherever_a_learnt_cell_aims():
    """The aim moves the mouth that the flight must enter, so that the object enters the real one; no arm enters it."""
    target = {"kind": "target", "position": [1.1, 0.2, 0.0], "opening": {"radius_m": 0.2, "rim_height_m": 0.3}}
    problem = problem_from_request({"release": target}, cell())
    aimed = aimed_problem(problem, np.array([0.07, -0.02, 0.0]))
    assert isinstance(aimed.release, TargetRelease)
    np.testing.assert_allclose(aimed.release.p_W, [1.17, 0.18, 0.0])
    (block,) = (box for box in aimed.cell_with_bin.surroundings.keep_out if box.name == "bin")
    np.testing.assert_allclose(block.lower, [0.9, 0.0, 0.0])
    np.testing.assert_allclose(block.upper, [1.3, 0.4, 0.3])
    back = aimed_problem(aimed, np.array([-0.07, 0.02, 0.0]))
    np.testing.assert_allclose(back.cell_with_bin.surroundings.keep_out[-1].lower, block.lower)
