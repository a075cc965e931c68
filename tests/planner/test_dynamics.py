"""Joint torques against Pinocchio's recursive Newton-Euler, with centres of mass and inertias by the URDF's route."""

import numpy as np
import pinocchio as pin
import pytest

from planner.dynamics import Payload, joint_torques
from planner.robots import ROBOT_NAMES, robot
from tests.planner.published_arms import pinocchio_arm

RNG = np.random.default_rng(9)
PAYLOAD = Payload(2.3, np.array([0.03, -0.05, 0.11]), np.diag([0.01, 0.02, 0.015]) + 0.001)
DOWN = np.array([0.0, 0.0, -9.81])
RTOL = 1e-9  # of the largest torque of the sample


def reference(model, gravity, q, qd, qdd):
    model.gravity.linear = gravity
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])


def assert_agrees(found, expected):
    scale = np.abs(expected).max(axis=-1, keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=RTOL)


def motion(count):
    return RNG.uniform(-6.0, 6.0, (count, 6)), RNG.normal(size=(count, 6)), 5.0 * RNG.normal(size=(count, 6))


@pytest.mark.parametrize("name", ROBOT_NAMES)
@pytest.mark.parametrize("gravity", [DOWN, np.array([3.0, -7.0, 5.0])], ids=["floor", "tilted"])
def test_torques_agree_with_pinocchio(name, gravity):
    q, qd, qdd = motion(100)
    expected = reference(pinocchio_arm(name, exact=True).copy(), gravity, q, qd, qdd)
    assert_agrees(joint_torques(robot(name), q, qd, qdd, gravity), expected)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_torques_with_a_payload_agree_with_pinocchio(name):
    model = pinocchio_arm(name, exact=True).copy()
    model.appendBodyToJoint(6, pin.Inertia(PAYLOAD.mass_kg, PAYLOAD.com_F, PAYLOAD.inertia_F), pin.SE3.Identity())
    q, qd, qdd = motion(100)
    expected = reference(model, DOWN, q, qd, qdd)
    assert_agrees(joint_torques(robot(name), q, qd, qdd, DOWN, PAYLOAD), expected)


def test_a_payload_without_mass_changes_nothing():
    q, qd, qdd = motion(5)
    nothing = Payload(0.0, np.zeros(3), np.zeros((3, 3)))
    np.testing.assert_array_equal(
        joint_torques(robot("ur5e"), q, qd, qdd, DOWN, nothing), joint_torques(robot("ur5e"), q, qd, qdd, DOWN)
    )


def test_one_sample_is_the_same_as_many():
    q, qd, qdd = (x.reshape(2, 3, 6) for x in motion(6))
    many = joint_torques(robot("ur20"), q, qd, qdd, DOWN, PAYLOAD)
    assert many.shape == (2, 3, 6)
    one = joint_torques(robot("ur20"), q[1, 2], qd[1, 2], qdd[1, 2], DOWN, PAYLOAD)
    np.testing.assert_allclose(many[1, 2], one, rtol=1e-12)
    assert joint_torques(robot("ur20"), q, np.zeros(6), np.zeros(6), DOWN).shape == (2, 3, 6)
