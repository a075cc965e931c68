"""Candidates: they meet the request, and the reason for having none is named."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box
from planner.errors import Infeasible
from planner.flight import fly
from planner.geometry import tool_pose, tool_state
from planner.kinematics import forward, inverse, jacobian, singularity_distances
from planner.planning import plan
from planner.problem import JointRelease, Opening, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.seeds import NoCandidates, candidates
from tests.planner.problems import cell, joint_problem, point_problem, pose_problem, random_state, with_boxes


def states(problem):
    found = candidates(problem)
    q = np.array([c.q for c in found])
    qd = np.array([c.qd for c in found])
    assert np.all(q >= problem.limits.q_lower - 1e-9)
    assert np.all(q <= problem.limits.q_upper + 1e-9)
    assert np.all(np.abs(qd) <= problem.limits.qd_max * (1 + 1e-9))
    assert [c.bound_s for c in found] == sorted(c.bound_s for c in found)
    return found, *tool_state(problem.cell, q, qd)


def test_pose_candidates_have_pose_and_twist_and_include_the_state_drawn():
    rng = np.random.default_rng(1)
    here = cell()
    for _ in range(20):
        q, qd = random_state(here, rng, 0.9)
        problem = pose_problem(here, q, 0.5 * qd)
        try:
            found, X, V = states(problem)
        except Infeasible:
            continue
        np.testing.assert_allclose(X, np.broadcast_to(problem.release.X_WT, X.shape), atol=1e-8)
        np.testing.assert_allclose(V, np.broadcast_to(problem.release.V_WT, V.shape), atol=1e-7)
        assert min(np.abs(c.q - q).max() for c in found) < 1e-7


NOT_ONE = {
    # behind the wall all that reaches the point passes through it; or the wrist would have to be too fast
    "clear of everything": (PointRelease(np.array([0.75, 0.1, 0.4]), np.array([0.8, 0.2, 0.5])), True),
    "within the limits on joint speed and singularity distance": (
        PointRelease(np.array([0.75, 0.1, 0.4]), np.array([2.8, 0.2, 2.5])),
        False,
    ),
}


@pytest.mark.parametrize("words", NOT_ONE)
def test_a_refusal_without_candidates_says_what_was_looked_at(words):
    release, is_walled = NOT_ONE[words]
    here = with_boxes(cell(), ([0.6, -0.5, 0.0], [0.65, 0.5, 1.5])) if is_walled else cell()
    problem = ThrowProblem(here, here.home, release, here.limits)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    (attempt,) = refusal.value.attempts
    states_tried, kept = attempt["result"].split(" release states: ")
    assert (attempt["backend"], kept) == ("candidates", f"none {words}")
    assert int(states_tried.removeprefix("the best ")) > 20
    assert attempt["duration_s"] > 0.0
    assert not any(violation.proven for violation in refusal.value.violations)
    assert refusal.value.nearest is not None
    if is_walled:
        (violation,) = refusal.value.violations
        assert violation.constraint == "keep_out"
        assert violation.detail.endswith(", box 0, at the release")


def test_the_states_of_a_pose_are_counted_limit_by_limit():
    """Its hand is through the floor; half of the turns of its joints are beyond a self-collision."""
    here = cell()
    X_WT = tool_pose(here, here.home).copy()
    X_WT[2, 3] = 0.03
    problem = ThrowProblem(here, here.home, PoseRelease(X_WT, np.array([0.6, 0.0, 0.3, 0.0, 0.0, 0.0])), here.limits)
    limits = here.limits
    reach = problem.reachable
    X_BT = np.linalg.inv(here.X_WB) @ X_WT
    q = inverse(here.robot, X_BT, here.tool.X_FT, limits.q_lower, limits.q_upper).q
    twist = np.concatenate([here.X_WB[:3, :3].T @ [0.6, 0.0, 0.3], np.zeros(3)])
    qd = np.array([np.linalg.solve(jacobian(here.robot, each, here.tool.X_FT), twist) for each in q])
    regular = (np.abs(qd) <= limits.qd_max).all(axis=1)
    regular &= singularity_distances(here.robot, q).minimum >= limits.singularity_distance_min
    reachable = regular & ((q >= reach.q_lower) & (q <= reach.q_upper)).all(axis=1)
    assert 0 < reachable.sum() < regular.sum()
    with pytest.raises(NoCandidates) as refusal:
        candidates(problem)
    total, _, kept = refusal.value.tried.partition(" release states: ")
    expected = [f"{regular.sum()} within the limits on joint speed and singularity distance"] * int(
        regular.sum() < len(q)
    )
    expected.append(f"{reachable.sum()} reachable without self-collision")
    assert int(total) == len(q)
    assert kept.split(", ")[: len(expected)] == expected
    assert kept.endswith(", none clear of everything")


def test_a_joint_release_is_one_state():
    here = cell()
    beyond = replace(here, limits=replace(here.limits, q_upper=here.home + 0.5))
    q = here.home + np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    problem = ThrowProblem(beyond, here.home, JointRelease(q, np.full(6, 0.1)), beyond.limits)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    (attempt,) = refusal.value.attempts
    assert attempt["result"] == "the release state: outside the joints' position limits"
    slow = replace(here, safety=replace(here.safety, elbow_speed_m_s=0.05))
    qd = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(Infeasible) as refusal:
        plan(ThrowProblem(slow, here.home, JointRelease(here.home, qd), here.limits))
    (attempt,) = refusal.value.attempts
    assert attempt["result"] == "the release state: none within the limits on tool and elbow speed and momentum"


def test_without_a_posture_the_refusal_says_how_many_orientations_were_tried():
    here = cell()
    narrow = replace(here.limits, q_lower=here.home - 0.02, q_upper=here.home + 0.02)
    problem = ThrowProblem(here, here.home, PointRelease(np.array([-0.4, 0.3, 0.4]), np.ones(3) * 0.1), narrow)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    (violation,) = refusal.value.violations
    assert (violation.constraint, violation.value, violation.limit) == ("joint_position", None, None)
    assert "in 1024 orientations of it" in violation.detail
    assert [each["result"] for each in refusal.value.attempts] == ["no release state was found"]


def test_point_candidates_have_place_and_velocity():
    rng = np.random.default_rng(2)
    here = cell()
    problem = point_problem(here, *random_state(here, rng, 0.6))
    _, X, V = states(problem)
    np.testing.assert_allclose(X[:, :3, 3], np.broadcast_to(problem.release.p_WT, (len(X), 3)), atol=1e-8)
    np.testing.assert_allclose(V[:, :3], np.broadcast_to(problem.release.v_WT, (len(X), 3)), atol=1e-8)


@pytest.mark.parametrize("drag_coefficient", [0.0, 0.47])
def test_target_candidates_hit(drag_coefficient):
    here = cell()
    here = replace(here, object=replace(here.object, drag_coefficient=drag_coefficient))
    target = TargetRelease(
        np.array([1.4, -0.5, 0.1]), max_speed_m_s=3.9, min_elevation_rad=0.1, min_horizontal_distance_m=0.5
    )
    problem = ThrowProblem(here, here.home, target, here.limits)
    _, X, V = states(problem)
    for X_WT, V_WT in zip(X, V, strict=True):
        flight = fly(X_WT[:3, 3], V_WT[:3], 0.1, problem.gravity, problem.drag)
        assert flight is not None
        np.testing.assert_allclose(flight.landing_point, target.p_W, atol=1e-6)
        assert np.linalg.norm(V_WT[:3]) <= 3.9
        assert np.arctan2(V_WT[2], np.hypot(*V_WT[:2])) >= 0.1 - 1e-9
        assert np.linalg.norm((X_WT[:3, 3] - target.p_W)[:2]) >= 0.5


def test_a_fixed_release_place_is_kept():
    here = cell()
    place = np.array([0.5, 0.2, 0.5])
    problem = ThrowProblem(
        here, here.home, TargetRelease(np.array([1.2, 0.5, 0.0]), release_position=place), here.limits
    )
    _, X, _ = states(problem)
    np.testing.assert_allclose(X[:, :3, 3], np.broadcast_to(place, (len(X), 3)), atol=1e-8)


def refusal(problem):
    with pytest.raises(Infeasible) as caught:
        candidates(problem)
    return caught.value.violations[0]


def test_out_of_reach_says_by_how_much():
    here = cell()
    X = np.eye(4)
    X[:3, 3] = [1.8, 0.0, 0.4]
    violation = refusal(ThrowProblem(here, here.home, PoseRelease(X, np.zeros(6)), here.limits))
    assert violation.constraint == "reach"
    assert violation.value > violation.limit
    point = refusal(ThrowProblem(here, here.home, PointRelease(X[:3, 3], np.ones(3)), here.limits))
    assert point.constraint == "reach"


@pytest.mark.parametrize(("joint", "angle", "name"), [(4, 0.0, "wrist"), (2, 0.0, "elbow")])
def test_a_singular_release_is_refused_by_name(joint, angle, name):
    q = np.array([0.3, -1.2, 1.1, -1.0, -1.4, 0.2])
    q[joint] = angle
    violation = refusal(joint_problem(release=JointRelease(q, np.full(6, 0.2))))
    assert violation.constraint == "singularity_distance"
    assert name in violation.detail


def test_a_shoulder_singular_pose_is_refused_by_name():
    here = cell()
    q = np.array([0.3, -1.2, 1.1, -1.0, -1.4, 0.2])
    # joint 2 that puts the wrist's centre on the axis of joint 1, by bisection on its horizontal offset
    low = -3.1
    high = 0.0

    def offset(lift):
        arm = here.robot
        return arm.a[1] * np.cos(lift) + arm.a[2] * np.cos(lift + q[2]) + arm.d[4] * np.sin(lift + q[2] + q[3])

    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(offset(middle)) == np.sign(offset(low)) else (low, middle)
    q[1] = low
    violation = refusal(joint_problem(release=JointRelease(q, np.full(6, 0.2))))
    assert violation.constraint == "singularity_distance"
    assert "shoulder" in violation.detail


def test_too_fast_names_the_joint_and_the_speed():
    here = cell()
    q = here.home + 0.2
    X_WT = here.X_WB @ forward(here.robot, q, here.tool.X_FT)
    violation = refusal(ThrowProblem(here, here.home, PoseRelease(X_WT, np.array([9.0, 0, 0, 0, 0, 0])), here.limits))
    assert violation.constraint == "joint_velocity"
    assert violation.value > violation.limit
    assert "joint" in violation.detail


@pytest.mark.parametrize(
    ("limits", "release", "constraint", "words"),
    [
        ({"singularity_distance_min": 0.9999}, {}, "singularity_distance", "keeps 0.9999 from singularities"),
        ({}, {"min_horizontal_distance_m": 9.0}, "release_position", "at least 9 m from the target"),
    ],
)
def test_what_leaves_no_posture_to_throw_from_is_named(limits, release, constraint, words):
    here = cell()
    target = TargetRelease(np.array([1.2, 0.3, 0.0]), **release)
    found = refusal(ThrowProblem(here, here.home, target, replace(here.limits, **limits)))
    assert found.constraint == constraint
    assert words in found.detail


def test_a_keep_in_box_that_no_posture_reaches_is_named():
    here = cell()
    far = Box(np.array([5.0, 5.0, 5.0]), np.array([6.0, 6.0, 6.0]))
    here = replace(here, surroundings=replace(here.surroundings, keep_in=(far,)))
    found = refusal(ThrowProblem(here, here.home, TargetRelease(np.array([1.2, 0.3, 0.0])), here.limits))
    assert found.constraint == "keep_in"


def test_a_joint_beyond_its_range_is_named():
    q = cell().home.copy()
    q[2] = 3.3
    violation = refusal(joint_problem(release=JointRelease(q, np.zeros(6))))
    assert (violation.constraint, violation.value) == ("joint_position", 3.3)
    assert "elbow" in violation.detail


def test_the_same_problem_has_the_same_candidates():
    here = cell()
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.4, -0.5, 0.1])), here.limits)
    first = candidates(problem)
    second = candidates(problem)
    assert [c.q.tolist() for c in first] == [c.q.tolist() for c in second]


NARROW_BIN = TargetRelease(np.array([0.8, -0.2, 0.0]), opening=Opening(0.12, 1.0))
