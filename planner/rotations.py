"""Rotations and poses: matrices, rotation vectors (UR's `rx ry rz`), unit quaternions `[x, y, z, w]`.

Every function accepts leading dimensions `...`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array

FULL_TURN = 2.0 * math.pi + 1e-3  # [rad] a rotation vector is no longer; with somebody's rounding
SMALL_ANGLE = 1e-2  # [rad] below it a series replaces the closed form, which loses digits to cancellation


def skew(v: ArrayLike) -> Array:
    """Returns the matrix (..., 3, 3) of the cross product with v (..., 3)."""
    v = np.asarray(v, dtype=np.float64)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1] = -v[..., 2]
    matrix[..., 0, 2] = v[..., 1]
    matrix[..., 1, 2] = -v[..., 0]
    return matrix - np.swapaxes(matrix, -1, -2)


def rotation_vector_to_matrix(vector: ArrayLike) -> Array:
    """Returns the rotation matrix (..., 3, 3) of a rotation vector (..., 3) [rad]. Source: Rodrigues' formula."""
    vector = np.asarray(vector, dtype=np.float64)
    half = 0.5 * np.linalg.norm(vector, axis=-1)[..., None]
    # np.sinc(x) is sin(pi x)/(pi x): the quaternion's vector part without a division by zero
    return quaternion_to_matrix(np.concatenate([0.5 * np.sinc(half / np.pi) * vector, np.cos(half)], axis=-1))


def roll_pitch_yaw_to_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Returns the rotation matrix (3, 3) of rotations [rad] about x, then y, then z: Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, cp, cy = map(math.cos, (roll, pitch, yaw))
    sr, sp, sy = map(math.sin, (roll, pitch, yaw))
    return np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]]
    )


def unit_hint(angle_rad: float) -> str:
    """Returns a question after a joint position of two turns and more [rad], which no joint reaches; else nothing."""
    return ": degrees?" if abs(angle_rad) > 2.0 * FULL_TURN else ""


def beyond_full_turn(vector: ArrayLike) -> str | None:
    """Returns why a rotation vector (3,) [rad] is refused, None for one that turns once at most."""
    angle = float(np.linalg.norm(vector))
    return None if angle <= FULL_TURN else f"turns by {angle:.4g} rad, must be a full turn (6.283) at most: degrees?"


def matrix_to_rotation_vector(R: ArrayLike) -> Array:
    """Returns the rotation vector (..., 3) [rad] of a rotation matrix (..., 3, 3); its length is at most pi."""
    quaternion = matrix_to_quaternion(R)
    vector = quaternion[..., :3]
    w = quaternion[..., 3:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, w)
    # 2 is the limit of angle/sine at no rotation
    return vector * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)


def angle_between(R_1: Array, R_2: Array) -> float:
    """Returns the angle [rad] between two rotation matrices (3, 3), exact to rounding unless it is nearly pi.

    |R_1 - R_2| = sqrt(8) sin(angle / 2) in Frobenius' norm.
    """
    return 2.0 * math.asin(min(1.0, float(np.linalg.norm(R_1 - R_2)) / math.sqrt(8.0)))


def quaternion_to_matrix(quaternion: ArrayLike) -> Array:
    """Returns the rotation matrix (..., 3, 3) of a quaternion [x, y, z, w] (..., 4), which is normalised first."""
    quaternion = np.asarray(quaternion, dtype=np.float64)
    x, y, z, w = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrix_to_quaternion(R: ArrayLike) -> Array:
    """Returns the unit quaternion [x, y, z, w] (..., 4) with w >= 0 of a rotation matrix (..., 3, 3).

    Source: Shepperd's method: of the four formulas, the one with the largest divisor.
    """
    R = np.asarray(R, dtype=np.float64)
    xx = R[..., 0, 0]
    yy = R[..., 1, 1]
    zz = R[..., 2, 2]
    xy = R[..., 0, 1] + R[..., 1, 0]
    xz = R[..., 0, 2] + R[..., 2, 0]
    yz = R[..., 1, 2] + R[..., 2, 1]
    wx = R[..., 2, 1] - R[..., 1, 2]
    wy = R[..., 0, 2] - R[..., 2, 0]
    wz = R[..., 1, 0] - R[..., 0, 1]
    # 4 q q^T: each row is the quaternion times one of its entries
    outer = np.stack(
        [
            np.stack([1.0 + xx - yy - zz, xy, xz, wx], axis=-1),
            np.stack([xy, 1.0 - xx + yy - zz, yz, wy], axis=-1),
            np.stack([xz, yz, 1.0 - xx - yy + zz, wz], axis=-1),
            np.stack([wx, wy, wz, 1.0 + xx + yy + zz], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.where(row[..., 3:] < 0.0, -row, row)


def rotation_vector_rate(vector: ArrayLike) -> Array:
    """Returns the matrix (..., 3, 3) from angular velocity, in the frame of R, to the rate of the rotation vector.

    The inverse of the left Jacobian of SO(3); singular at an angle of 2 pi, regular for vectors of length up to pi.
    Source: Chirikjian, "Stochastic Models, Information Theory, and Lie Groups 2", (10.86).
    """
    vector = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    large = np.where(angle < SMALL_ANGLE, 1.0, angle)
    closed = (1.0 - 0.5 * large / np.tan(0.5 * large)) / large**2
    second = np.where(angle < SMALL_ANGLE, 1.0 / 12.0 + angle**2 / 720.0 + angle**4 / 30240.0, closed)
    K = skew(vector)
    return np.eye(3) - 0.5 * K + second * (K @ K)


def axes_along(z: Array) -> Array:
    """Returns right-handed axes (3, 3), one a column, of which the last is a unit vector `z` (3,)."""
    x = np.cross([1.0, 0.0, 0.0] if abs(z[0]) < 0.9 else [0.0, 1.0, 0.0], z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def pose(position: ArrayLike, R: ArrayLike) -> Array:
    """Returns the homogeneous pose (..., 4, 4) of a position (..., 3) [m] and a rotation matrix (..., 3, 3)."""
    position = np.asarray(position, dtype=np.float64)
    R = np.asarray(R, dtype=np.float64)
    X = np.zeros((*np.broadcast_shapes(position.shape[:-1], R.shape[:-2]), 4, 4))
    X[..., :3, :3] = R
    X[..., :3, 3] = position
    X[..., 3, 3] = 1.0
    return X


def invert_pose(X: ArrayLike) -> Array:
    """Returns the inverse (..., 4, 4) of a pose (..., 4, 4)."""
    X = np.asarray(X, dtype=np.float64)
    R_inverse = np.swapaxes(X[..., :3, :3], -1, -2)
    return pose(-np.einsum("...ij,...j->...i", R_inverse, X[..., :3, 3]), R_inverse)
