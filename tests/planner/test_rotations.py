"""Rotations against scipy, finite differences and the axioms of the group."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner.rotations import (
    invert_pose,
    matrix_to_quaternion,
    matrix_to_rotation_vector,
    pose,
    quaternion_to_matrix,
    rotation_vector_rate,
    rotation_vector_to_matrix,
    skew,
)

RNG = np.random.default_rng(11)
ANGLES = np.concatenate([[0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.00999, 0.01001, 1.0, 3.0], np.pi - np.logspace(-12, -1, 8)])
VECTORS = np.concatenate(
    [angle * axis / np.linalg.norm(axis) for angle in ANGLES for axis in [RNG.normal(size=(1, 3))]]
)


def test_rotation_vectors_agree_with_scipy():
    np.testing.assert_allclose(
        rotation_vector_to_matrix(VECTORS), Rotation.from_rotvec(VECTORS).as_matrix(), rtol=0, atol=1e-15
    )


def test_rotation_vectors_come_back():
    np.testing.assert_allclose(
        matrix_to_rotation_vector(rotation_vector_to_matrix(VECTORS)), VECTORS, rtol=0, atol=2e-15
    )


@pytest.mark.parametrize("axis", np.eye(3))
def test_a_half_turn_has_length_pi(axis):
    vector = matrix_to_rotation_vector(rotation_vector_to_matrix(np.pi * axis))
    np.testing.assert_allclose(np.abs(vector), np.pi * axis, rtol=0, atol=1e-15)


def test_quaternions_agree_with_scipy():
    R = Rotation.random(1000, rng=RNG).as_matrix()
    quaternion = matrix_to_quaternion(R)
    np.testing.assert_allclose(quaternion, Rotation.from_matrix(R).as_quat(canonical=True), rtol=0, atol=1e-14)
    np.testing.assert_allclose(quaternion_to_matrix(3.0 * quaternion), R, rtol=0, atol=1e-14)


def test_rotation_vector_rate_agrees_with_finite_differences():
    vectors = VECTORS[:9]
    spin = np.array([0.3, -0.5, 0.8])
    h = 1e-6
    R = rotation_vector_to_matrix(vectors)
    ahead, behind = (matrix_to_rotation_vector(rotation_vector_to_matrix(s * h * spin) @ R) for s in (1, -1))
    np.testing.assert_allclose(rotation_vector_rate(vectors) @ spin, (ahead - behind) / (2 * h), rtol=0, atol=1e-9)


def test_rotation_vector_rate_is_smooth_where_its_form_changes():
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    below, above = rotation_vector_rate(np.outer([0.01 - 1e-12, 0.01 + 1e-12], axis))
    np.testing.assert_allclose(below, above, rtol=0, atol=1e-11)


def test_poses_are_a_group():
    X = pose(RNG.normal(size=(20, 3)), Rotation.random(20, rng=RNG).as_matrix())
    np.testing.assert_allclose(invert_pose(X) @ X, np.broadcast_to(np.eye(4), X.shape), rtol=0, atol=1e-15)
    np.testing.assert_allclose(invert_pose(invert_pose(X)), X, rtol=0, atol=1e-15)


def test_cross_products_agree_with_numpy():
    a, b = RNG.normal(size=(2, 7, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b), rtol=0, atol=1e-15)
