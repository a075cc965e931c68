"""Poses, Jacobians and velocities against Pinocchio, built from the published URDF numbers, and finite differences."""

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.published_arms import pinocchio_arm
from planner.kinematics import (
    analytical_jacobian,
    forward,
    forward_velocity,
    inverse_velocity,
    jacobian,
    jacobian_dot_qd,
    link_poses,
    manipulability,
    signed_singularity_distances,
    singularity_distances,
    smallest_singular_value,
    tcp_acceleration,
)
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix

RNG = np.random.default_rng(7)
X_FT = pose([0.03, -0.05, 0.17], rotation_vector_to_matrix([0.3, -0.2, 0.5]))
H = 1e-6  # [rad] step of the central differences: truncation and rounding both near 1e-10
ATOL_PUBLISHED = 1e-9  # the published quarter turns are rounded to nine decimals


def configurations(arm, count):
    return RNG.uniform(arm.q_lower, arm.q_upper, (count, 6))


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_pose_and_jacobian_agree_with_pinocchio(name):
    arm = robot(name)
    model = pinocchio_arm(name)
    data = model.createData()
    q = configurations(robot(name), 100)
    X = forward(arm, q)
    J = jacobian(arm, q)
    for i in range(len(q)):
        pin.computeJointJacobians(model, data, q[i])
        J_pin = pin.getJointJacobian(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(X[i], data.oMi[6].homogeneous, rtol=0, atol=ATOL_PUBLISHED)
        np.testing.assert_allclose(J[i], J_pin, rtol=0, atol=ATOL_PUBLISHED)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_acceleration_of_the_flange_agrees_with_pinocchio(name):
    arm = robot(name)
    model = pinocchio_arm(name, exact=True)
    data = model.createData()
    q = configurations(robot(name), 30)
    qd, qdd = RNG.normal(size=(2, 30, 6))
    acceleration = tcp_acceleration(arm, q, qd, qdd)
    for i in range(len(q)):
        pin.forwardKinematics(model, data, q[i], qd[i], qdd[i])
        expected = pin.getClassicalAcceleration(model, data, 6, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(acceleration[i], expected, rtol=0, atol=1e-8)


def differences(function, q):
    """Central differences (n, ..., 6) of a function by each joint."""
    steps = H * np.eye(6)
    return np.stack([(function(q + step) - function(q - step)) / (2 * H) for step in steps], axis=-1)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_jacobian_with_tool_agrees_with_finite_differences(name):
    arm = robot(name)
    q = configurations(robot(name), 50)
    J = jacobian(arm, q, X_FT)
    X = forward(arm, q, X_FT)
    np.testing.assert_allclose(J[:, :3], differences(lambda q: forward(arm, q, X_FT)[:, :3, 3], q), rtol=0, atol=1e-8)
    turned = differences(lambda q: forward(arm, q, X_FT)[:, :3, :3], q)
    for k in range(6):
        skew = turned[..., k] @ np.swapaxes(X[:, :3, :3], -1, -2)
        spin = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(J[:, 3:, k], spin, rtol=0, atol=1e-8)


def test_analytical_jacobian_agrees_with_finite_differences():
    arm = robot("ur5e")
    q = configurations(robot("ur5e"), 400)
    vector = matrix_to_rotation_vector(forward(arm, q, X_FT)[:, :3, :3])
    q = q[np.linalg.norm(vector, axis=-1) < np.pi - 0.05]  # the rotation vector flips at half a turn

    def coordinates(q):
        X = forward(arm, q, X_FT)
        return np.concatenate([X[:, :3, 3], matrix_to_rotation_vector(X[:, :3, :3])], axis=-1)

    np.testing.assert_allclose(analytical_jacobian(arm, q, X_FT), differences(coordinates, q), rtol=0, atol=2e-8)


def test_jacobian_rate_agrees_with_finite_differences():
    arm = robot("ur10e")
    q = configurations(robot("ur10e"), 50)
    qd = RNG.normal(size=(50, 6))
    rate = (jacobian(arm, q + H * qd, X_FT) - jacobian(arm, q - H * qd, X_FT)) / (2 * H)
    np.testing.assert_allclose(jacobian_dot_qd(arm, q, qd, X_FT), forward_velocity(rate, qd), rtol=0, atol=1e-7)


def test_one_sample_is_the_same_as_many():
    arm = robot("ur3e")
    q = configurations(robot("ur3e"), 12)
    many = q.reshape(3, 4, 6)
    for function in (link_poses, forward, jacobian, analytical_jacobian, signed_singularity_distances):
        np.testing.assert_array_equal(function(arm, many)[1, 2], function(arm, many[1, 2]))


def test_inverse_velocity_of_a_square_jacobian_is_exact():
    arm = robot("ur5e")
    q = configurations(robot("ur5e"), 200)
    J = jacobian(arm, q, X_FT)
    qd = RNG.normal(size=(200, 6))
    regular = singularity_distances(arm, q).minimum > 0.05
    found = inverse_velocity(J[regular], forward_velocity(J, qd)[regular])
    np.testing.assert_allclose(found, qd[regular], rtol=0, atol=1e-11)


@pytest.mark.parametrize(("rows", "joints"), [(3, 6), (6, 7), (3, 9), (6, 4)])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_inverse_velocity_solves_the_weighted_least_squares(rows, joints, damping):
    J = RNG.normal(size=(5, rows, joints))
    twist = RNG.normal(size=(5, rows))
    weights = RNG.uniform(0.5, 2.0, joints)
    small = damping if damping else 1e-6  # the undamped answer is the limit of the damped one
    for i, qd in enumerate(inverse_velocity(J, twist, damping, weights)):
        tall = np.concatenate([J[i], small * np.diag(np.sqrt(weights))])
        expected = np.linalg.lstsq(tall, np.concatenate([twist[i], np.zeros(joints)]), rcond=None)[0]
        np.testing.assert_allclose(qd, expected, rtol=0, atol=1e-9)


def test_inverse_velocity_stays_finite_on_a_singularity():
    J = jacobian(robot("ur5e"), [0.1, -1.0, 0.0, 0.4, 0.7, 0.0])
    assert np.all(np.isfinite(inverse_velocity(J, np.ones(6), weights=np.ones(6))))
    assert np.linalg.norm(inverse_velocity(J, np.ones(6), damping=0.1)) < 0.5 * np.sqrt(6) / 0.1 + 1e-9


@pytest.mark.parametrize("arguments", [{"damping": -1.0}, {"weights": [1, 1, 0, 1, 1, 1]}])
def test_inverse_velocity_refuses_what_has_no_meaning(arguments):
    with pytest.raises(ValueError, match="must"):
        inverse_velocity(np.eye(6), np.ones(6), **arguments)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_singularity_distances_factor_the_determinant(name):
    arm = robot(name)
    q = configurations(robot(name), 500)
    upper, fore = np.abs(arm.a[1:3])
    distances = singularity_distances(arm, q)
    product = distances.wrist * distances.elbow * distances.shoulder * upper * fore * (upper + fore)
    J = jacobian(arm, q, X_FT)
    np.testing.assert_allclose(np.abs(np.linalg.det(J)), product, rtol=0, atol=1e-12)
    np.testing.assert_allclose(manipulability(J), product, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "q"), [("wrist", [0.1, -1.2, 1.3, -0.5, 0.0, 0.3]), ("elbow", [0.1, -1.2, 0.0, -0.5, 0.7, 0.3])]
)
def test_a_singularity_has_distance_zero_and_loses_a_direction(name, q):
    distances = singularity_distances(robot("ur5e"), q)
    others = {"wrist", "elbow", "shoulder"} - {name}
    assert getattr(distances, name) == distances.minimum == 0.0
    assert all(getattr(distances, other) > 0.1 for other in others)
    assert smallest_singular_value(jacobian(robot("ur5e"), q)) < 1e-15


def test_manipulability_of_a_tall_jacobian_is_zero():
    assert manipulability(np.ones((6, 4))) == 0.0
