"""Inverse kinematics: every branch and turn, singular and unreachable poses distinguished."""

import numpy as np
import pytest

from planner.kinematics import forward, inverse, inverse_branches, singularity_distances
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import pose, rotation_vector_to_matrix

COUNT = 10_000
ATOL = 1e-9
X_FT = pose([0.03, -0.05, 0.17], rotation_vector_to_matrix([0.3, -0.2, 0.5]))
REGULAR = np.array([0.4, -1.3, 1.4, -0.7, 1.1, 0.2])


def apart(a, b):
    """Largest difference of angles (..., 6), whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_branches_hold_the_configuration_and_reproduce_the_pose(name):
    arm = robot(name)
    q = np.random.default_rng(2).uniform(arm.q_lower, arm.q_upper, (COUNT, 6))
    X = forward(arm, q, X_FT)
    branches, excess = inverse_branches(arm, X, X_FT)
    reached = np.isfinite(branches).all(axis=-1)
    distance = np.where(reached, apart(np.nan_to_num(branches), q[:, None]), np.inf)
    assert distance.min(axis=1).max() < ATOL
    again = forward(arm, branches[reached], X_FT)
    np.testing.assert_allclose(again, np.repeat(X, reached.sum(axis=1), axis=0), rtol=0, atol=ATOL)
    assert np.array_equal(reached, excess == 0.0)
    assert np.all(np.abs(branches[reached]) <= np.pi)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_one_pose_gives_every_turn_within_the_limits(name):
    arm = robot(name)
    for q in np.random.default_rng(3).uniform(arm.q_lower, arm.q_upper, (20, 6)):
        X = forward(arm, q)
        found = inverse(arm, X)
        branches = inverse_branches(arm, X)[0]
        assert np.abs(found.q - q).max(axis=1).min() < ATOL
        assert np.all((found.q >= arm.q_lower) & (found.q <= arm.q_upper))
        # two turns of each of five joints of +-2 pi, one of the elbow; no two solutions the same
        assert len(found.q) == 32 * np.isfinite(branches[:, 0]).sum()
        assert len(np.unique(np.round(found.q, 6), axis=0)) == len(found.q)
        np.testing.assert_allclose(forward(arm, found.q), np.broadcast_to(X, (len(found.q), 4, 4)), rtol=0, atol=ATOL)
        assert found.reachable
        assert found.singular == ()


def test_tightened_limits_leave_only_what_is_inside():
    arm = robot("ur5e")
    width = 0.1
    found = inverse(arm, forward(arm, REGULAR), None, REGULAR - width, REGULAR + width)
    np.testing.assert_allclose(found.q, [REGULAR], rtol=0, atol=ATOL)


def test_a_solution_on_a_limit_is_kept_on_it():
    arm = robot("ur5e")
    found = inverse(arm, forward(arm, REGULAR), None, REGULAR, REGULAR)
    np.testing.assert_array_equal(found.q, [REGULAR])


def test_reachable_outside_the_limits_is_not_out_of_reach():
    arm = robot("ur5e")
    found = inverse(arm, forward(arm, REGULAR), None, np.full(6, 3.0), np.full(6, 3.1))
    assert len(found.q) == 0
    assert found.reachable


def shoulder_singular(arm):
    """A configuration with the wrist's centre over the axis of joint 1."""
    elbow = 1.2
    # a2 cos(q2) + a3 cos(q2 + q3) + d5 sin(q2 + q3 + q4) = 0, solved for the last angle
    lifts = np.arange(-3.0, 0.0, 0.01)
    sines = -(arm.a[1] * np.cos(lifts) + arm.a[2] * np.cos(lifts + elbow)) / arm.d[4]
    first = np.argmax(np.abs(sines) < 0.9)
    lift = lifts[first]
    turn = np.arcsin(sines[first])
    return np.array([0.3, lift, elbow, turn - lift - elbow, 0.9, 0.1])


@pytest.mark.parametrize("name", ROBOT_NAMES)
@pytest.mark.parametrize("singularity", ["wrist", "elbow", "shoulder"])
def test_singular_poses_are_named_and_solved(name, singularity):
    arm = robot(name)
    q = {
        "wrist": np.array([0.4, -1.3, 1.4, -0.7, 0.0, 0.2]),
        "elbow": np.array([0.4, -1.3, 0.0, -0.7, 1.1, 0.2]),
        "shoulder": shoulder_singular(arm),
    }[singularity]
    assert getattr(singularity_distances(arm, q), singularity) < 1e-12
    X = forward(arm, q, X_FT)
    found = inverse(arm, X, X_FT)
    assert singularity in found.singular
    assert found.reachable
    assert len(found.q) > 0
    np.testing.assert_allclose(forward(arm, found.q, X_FT), np.broadcast_to(X, (len(found.q), 4, 4)), rtol=0, atol=ATOL)


@pytest.mark.parametrize("flip", [0.0, np.pi])
def test_a_wrist_singular_pose_is_solved_whatever_joint_six_was(flip):
    arm = robot("ur5e")
    for turn in np.linspace(-3.0, 3.0, 25):
        q = np.array([0.4, -0.4, 0.3, turn, flip, 0.2])  # nearly stretched: most choices of joint 6 are out of reach
        found = inverse(arm, forward(arm, q))
        assert "wrist" in found.singular
        assert len(found.q) > 0
        np.testing.assert_allclose(forward(arm, found.q)[0], forward(arm, q), rtol=0, atol=ATOL)


@pytest.mark.parametrize("name", ROBOT_NAMES)
@pytest.mark.parametrize("beyond", [1e-6, 0.05, 2.0])
def test_out_of_reach_says_by_how_much(name, beyond):
    arm = robot(name)
    q = np.array([0.4, -1.3, 0.0, -0.7, 1.1, 0.2])  # stretched
    X = forward(arm, q)
    upper_arm = np.array([np.cos(q[0]) * np.cos(q[1]), np.sin(q[0]) * np.cos(q[1]), np.sin(q[1])])
    X[:3, 3] -= upper_arm * beyond  # the arm's links point against their x axes
    found = inverse(arm, X)
    assert len(found.q) == 0
    assert found.singular == ()
    assert not found.reachable
    assert found.reach_excess_m == pytest.approx(beyond, rel=1e-6, abs=1e-9)


def test_too_near_the_axis_of_joint_one_is_out_of_reach():
    arm = robot("ur5e")
    X = pose([0.0, 0.0, 0.6 + arm.d[5]], np.eye(3))
    found = inverse(arm, X)
    assert not found.reachable
    assert found.reach_excess_m == pytest.approx(arm.d[3])


def test_one_pose_is_the_same_as_many():
    arm = robot("ur10e")
    X = forward(arm, np.random.default_rng(4).uniform(-3, 3, (2, 5, 6)))
    many, excess = inverse_branches(arm, X)
    one, one_excess = inverse_branches(arm, X[1, 3])
    np.testing.assert_array_equal(many[1, 3], one)
    np.testing.assert_array_equal(excess[1, 3], one_excess)
