import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import kinematics as planner
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import rotation_vector_to_matrix
from simulator.physics import kinematics as scalar
from simulator.physics.controller_kinematics import checksums, controller_table
from simulator.truth import DhDeviation
from tests.planner.calibration.arms import deviated_table, measured_arm

TOOL = scalar.transform([0.01, -0.02, 0.17, 0.1, 0.2, -0.3])
EXACT = 1e-12  # [m, rad, m/s] two orders of the same sums of products differ by rounding alone
ANGLES = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6)


def matrix(t):
    return np.array([*t, 0, 0, 0, 1]).reshape(4, 4)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_pose_twist_and_jacobian_are_the_planners(name):
    arm = robot(name)
    chain = scalar.KinematicChain(controller_table(robot(name)))
    draw = np.random.default_rng(0)
    for q, qd in draw.uniform(-3, 3, (50, 2, 6)):
        pose, twist = chain.motion(q.tolist(), qd.tolist(), TOOL)
        J, same = chain.jacobian(q.tolist(), TOOL)
        np.testing.assert_allclose(matrix(pose), planner.forward(arm, q, matrix(TOOL)), atol=EXACT)
        np.testing.assert_allclose(matrix(same), matrix(pose), atol=EXACT)
        np.testing.assert_allclose(J, planner.jacobian(arm, q, matrix(TOOL)), atol=EXACT)
        np.testing.assert_allclose(twist, J @ qd, atol=1e-11)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.floats(0.0, math.pi))
def test_a_rotation_vector_comes_back(axis, angle):
    length = math.hypot(*axis)
    vector = [x / length * angle for x in axis] if length > 1e-3 else [0.0, 0.0, angle]
    t = scalar.transform([1.0, 2.0, 3.0, *vector])
    np.testing.assert_allclose(matrix(t)[:3, :3], rotation_vector_to_matrix(np.array(vector)), atol=EXACT)
    again = scalar.transform([1.0, 2.0, 3.0, *scalar.rotation_vector(t)])
    np.testing.assert_allclose(again, t, atol=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.0, -0.8), (0.6, 0.64, 0.48)])
@pytest.mark.parametrize("short_of_pi", [0.0, 1e-9, 1e-7, 1e-5])
def test_half_turns_keep_axis_and_sign(axis, short_of_pi):
    angle = math.pi - short_of_pi
    found = scalar.rotation_vector(scalar.transform([0, 0, 0, *(angle * x for x in axis)]))
    sign = 1.0 if short_of_pi else math.copysign(1.0, np.dot(found, axis))
    np.testing.assert_allclose(np.array(found) * sign, np.multiply(axis, angle), atol=1e-8)


@given(ANGLES, st.lists(st.floats(-0.05, 0.05), min_size=6, max_size=6))
def test_newton_finds_the_pose_again(q, step):
    chain = scalar.KinematicChain(controller_table(robot("ur5e")))
    goal = chain.forward(q, TOOL)
    found = chain.solve(goal, [a + b for a, b in zip(q, step, strict=True)], TOOL)
    if found is not None:  # next to a singularity Newton's method may fail; the caller then uses the closed form
        assert max(map(abs, scalar.pose_error(goal, chain.forward(found, TOOL)))) < 1e-9


def test_inverse_of_a_transform():
    np.testing.assert_allclose(matrix(scalar.product(TOOL, scalar.inverse(TOOL))), np.eye(4), atol=EXACT)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_arm_of_a_calibrated_cell_is_the_planners(name: str) -> None:
    rng = np.random.default_rng(len(name))
    arm = measured_arm(name, deviated_table(name, rng))
    chain = scalar.KinematicChain(controller_table(arm))
    for q in rng.uniform(-6.0, 6.0, (20, 6)):
        X = planner.forward(arm, q)
        J = planner.jacobian(arm, q)
        pose, twist = chain.motion(q.tolist(), (qd := rng.uniform(-2.0, 2.0, 6)).tolist())
        assert np.abs(np.array(pose).reshape(3, 4) - X[:3]).max() < 1e-9
        assert np.abs(np.array(twist) - J @ qd).max() < 1e-9


def test_a_true_arm_that_deviates_is_not_the_calibrated_one() -> None:
    arm = measured_arm("ur5e", deviated_table("ur5e", np.random.default_rng(3)))
    deviation = DhDeviation(a_m=(0.0, 0.003, 0.0, 0.0, 0.0, 0.0))
    of_model = controller_table(robot("ur5e"), deviation)
    assert checksums(controller_table(arm, deviation)) == checksums(of_model)
