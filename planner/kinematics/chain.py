"""Where the links are and how they move: poses, Jacobians, velocities and accelerations along the chain.

Frames: B arm base (DH frame 0), F flange (DH frame 6), T tool centre point. Everything is expressed in B and works
over leading dimensions `...` of q.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.robots import Robot
from planner.rotations import cross, matrix_to_rotation_vector, rotation_vector_rate

Array = NDArray[np.float64]


def link_poses(robot: Robot, q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Poses (..., 7, 4, 4) of the DH frames: index 0 is the base itself, 6 the flange.

    Args:
        q: joint positions (..., 6) [rad].
        X_WB: pose of the base (4, 4); the poses are in the base where it is None.

    Source: Denavit and Hartenberg, distal convention: Rot_z(q) Trans_z(d) Trans_x(a) Rot_x(alpha).
    """
    A = _joint_poses(robot, np.asarray(q, dtype=np.float64))
    X = np.empty((*A.shape[:-3], 7, 4, 4))
    X[..., 0, :, :] = np.eye(4) if X_WB is None else X_WB
    X[..., 1, :, :] = A[..., 0, :, :] if X_WB is None else np.asarray(X_WB, dtype=np.float64) @ A[..., 0, :, :]
    for i in range(1, 6):
        np.matmul(X[..., i, :, :], A[..., i, :, :], out=X[..., i + 1, :, :])
    return X


def _joint_poses(robot: Robot, q: Array) -> Array:
    """Pose (..., 6, 4, 4) of each DH frame in the one before it."""
    c, s = np.cos(q), np.sin(q)
    c_alpha, s_alpha = twists(robot)
    A = np.zeros((*q.shape, 4, 4))
    A[..., 0, 0], A[..., 0, 1], A[..., 0, 2], A[..., 0, 3] = c, -s * c_alpha, s * s_alpha, robot.a * c
    A[..., 1, 0], A[..., 1, 1], A[..., 1, 2], A[..., 1, 3] = s, c * c_alpha, -c * s_alpha, robot.a * s
    A[..., 2, 1], A[..., 2, 2], A[..., 2, 3], A[..., 3, 3] = s_alpha, c_alpha, robot.d, 1.0
    return A


@cache
def twists(robot: Robot) -> tuple[Array, Array]:
    """Cosines and sines (6,) of the twists; exact zeros for quarter turns, where floating point leaves 6e-17."""
    values = np.cos(robot.alpha), np.sin(robot.alpha)
    cos, sin = (np.where(np.abs(v) < np.finfo(np.float64).eps, 0.0, v) for v in values)
    return cos, sin


def forward(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Pose X_BT (..., 4, 4) of the tool (the flange where `X_FT` is None) in the base."""
    X_BF = link_poses(robot, q)[..., 6, :, :]
    return X_BF if X_FT is None else X_BF @ np.asarray(X_FT, dtype=np.float64)


def jacobian(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Geometric Jacobian (..., 6, 6) at the tool, in the base: rows linear [m/rad], then angular [1] velocity."""
    X = link_poses(robot, q)
    axes, origins = X[..., :6, :3, 2], X[..., :6, :3, 3]
    J_v = cross(axes, _tool_point(X, X_FT)[..., None, :] - origins)
    return np.swapaxes(np.concatenate([J_v, axes], axis=-1), -1, -2)


def _tool_point(X: Array, X_FT: ArrayLike | None) -> Array:
    """Tool centre point (..., 3) from the link poses."""
    p_BF = X[..., 6, :3, 3]
    return p_BF if X_FT is None else p_BF + X[..., 6, :3, :3] @ np.asarray(X_FT, dtype=np.float64)[:3, 3]


def analytical_jacobian(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Jacobian (..., 6, 6) to the rates of position [m/rad] and rotation vector [1] of the tool in the base.

    Valid while the rotation is less than a full turn of pi, where the rotation vector flips.
    """
    J = jacobian(robot, q, X_FT)
    vector = matrix_to_rotation_vector(forward(robot, q, X_FT)[..., :3, :3])
    J[..., 3:, :] = rotation_vector_rate(vector) @ J[..., 3:, :]
    return J


def tcp_acceleration(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Linear [m/s2] and angular [rad/s2] acceleration (..., 6) of the tool in the base: J qdd + dJ/dt qd."""
    X = link_poses(robot, q)
    spin, spin_rate = angular_motion(X, np.asarray(qd, dtype=np.float64), np.asarray(qdd, dtype=np.float64))
    ends = np.concatenate([X[..., 1:6, :3, 3], _tool_point(X, X_FT)[..., None, :]], axis=-2)
    arms = ends - X[..., :6, :3, 3]
    linear = centre_acceleration(spin, spin_rate, arms).sum(axis=-2)
    return np.concatenate([linear, spin_rate[..., 5, :]], axis=-1)


def jacobian_dot_qd(robot: Robot, q: ArrayLike, qd: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """The part dJ/dt qd (..., 6) of the tool's acceleration that is there without joint acceleration."""
    return tcp_acceleration(robot, q, qd, np.zeros(6), X_FT)


def angular_motion(X: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """Angular velocity and acceleration (..., 6, 3) of the links, from the link poses (..., 7, 4, 4)."""
    turn = X[..., :6, :3, 2] * qd[..., None]
    spin = np.cumsum(turn, axis=-2)
    return spin, np.cumsum(X[..., :6, :3, 2] * qdd[..., None] + cross(spin - turn, turn), axis=-2)


def centre_acceleration(spin: Array, spin_rate: Array, arm: Array) -> Array:
    """Acceleration (..., 3) of a point at `arm` from another point of the same body, relative to that point."""
    return cross(spin_rate, arm) + cross(spin, cross(spin, arm))
