"""Joint torques against Pinocchio's recursive Newton-Euler, with centres of mass and inertias by the URDF's route."""

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.published_arms import pinocchio_arm
from planner.cell import ThrownBody, cell_of_keys
from planner.certificate import ArmSamples
from planner.dynamics import Payload, joint_torques, payload_of
from planner.kinematics import LinkMotion, link_poses
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import rotation_vector_to_matrix
from tests.planner.problems import cell

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


HELD = {
    "shape": "box",
    "mass_kg": 1.2,
    "size_m": [0.05, 0.1, 0.2],
    "in_tool": {"position_m": [0.02, -0.03, 0.08], "rotation_vector_rad": [0.4, -0.7, 0.2]},
}


def test_a_held_body_weighs_and_turns_where_it_is_and_the_hand_where_it_was():
    document = cell().document
    tool = {**document["tool"], "mass_kg": 1.7, "tcp_rotation_vector_rad": [0.3, 0.1, -0.5]}
    here = cell_of_keys({**document, "tool": tool, "object": HELD})
    thing = here.object
    assert isinstance(thing, ThrownBody)
    model = pinocchio_arm(here.robot.name, exact=True).copy()
    X_FT = pin.SE3(rotation_vector_to_matrix(tool["tcp_rotation_vector_rad"]), np.array(tool["tcp_position_m"]))
    held = pin.SE3(rotation_vector_to_matrix(HELD["in_tool"]["rotation_vector_rad"]), np.array([0.02, -0.03, 0.08]))
    box = pin.Inertia.FromBox(1.2, 0.05, 0.1, 0.2)
    hand = pin.Inertia(1.7, 0.5 * X_FT.translation, np.zeros((3, 3)))
    model.appendBodyToJoint(6, hand, pin.SE3.Identity())
    model.appendBodyToJoint(6, box, X_FT * held)
    q, qd, qdd = motion(50)
    expected = reference(model, DOWN, q, qd, qdd)
    assert_agrees(joint_torques(here.robot, q, qd, qdd, DOWN, payload_of(here, with_object=True)), expected)
    chain = LinkMotion(link_poses(here.robot, q, here.X_WB), qd, qdd)
    terms = ArmSamples(here, np.zeros(50), chain.X, chain, chain.on_flange(here.tool.X_FT[:3, 3])).loaded_torques
    base = reference(model, here.X_WB[:3, :3].T @ DOWN, q, qd, qdd)
    assert_agrees(terms.whole.T, base)
    bare = pinocchio_arm(here.robot.name, exact=True).copy()
    bare.appendBodyToJoint(6, hand, pin.SE3.Identity())
    gone = joint_torques(here.robot, q, qd, qdd, DOWN, payload_of(here, with_object=False))
    assert_agrees(gone, reference(bare, DOWN, q, qd, qdd))
