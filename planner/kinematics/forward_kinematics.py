"""Forward kinematics: link poses, tool pose, Jacobians and tool acceleration.

Frames: B arm base (DH frame 0), F flange (DH frame 6), T tool centre point. Everything is expressed in B and works
over leading dimensions `...` of q.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.kinematics.link_motion import LinkMotion, cross
from planner.robots import Robot
from planner.rotations import matrix_to_rotation_vector, rotation_vector_rate


def link_poses(robot: Robot, q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Returns the poses (..., 7, 4, 4) of the DH frames; index 0 is the base, 6 the flange.

    Source: Denavit and Hartenberg, distal convention: Rot_z(q) Trans_z(d) Trans_x(a) Rot_x(alpha).

    Args:
        robot: the arm.
        q: joint positions (..., 6) [rad].
        X_WB: pose of the base (4, 4); the poses are in the base where it is None.
    """
    q = np.asarray(q, dtype=np.float64)
    cos, sin = (np.ascontiguousarray(f(q).reshape(-1, 6).T) for f in (np.cos, np.sin))
    base = np.eye(4) if X_WB is None else np.asarray(X_WB, dtype=np.float64)
    x, y, z, p = (np.repeat(base[:3, k, None], cos.shape[1], axis=1) for k in range(4))
    X = np.zeros((cos.shape[1], 7, 4, 4))
    X[:, 0], X[:, 1:, 3, 3] = base, 1.0
    for i, (c_alpha, s_alpha) in enumerate(zip(*_twists(robot), strict=True)):
        x, turned = cos[i] * x + sin[i] * y, cos[i] * y - sin[i] * x
        if robot.d[i] != 0.0:
            p = p + robot.d[i] * z
        if robot.a[i] != 0.0:
            p = p + robot.a[i] * x
        if c_alpha == 1.0:
            y = turned
        else:
            y, z = c_alpha * turned + s_alpha * z, c_alpha * z - s_alpha * turned
        for column, vector in enumerate((x, y, z, p)):
            X[:, i + 1, :3, column] = vector.T
    return X.reshape(*q.shape[:-1], 7, 4, 4)


@cache
def _twists(robot: Robot) -> tuple[Array, Array]:
    """Returns cosines and sines (6,) of the DH twists, exactly 0 for quarter turns, where floats leave 6e-17."""
    values = np.cos(robot.alpha), np.sin(robot.alpha)
    cos, sin = (np.where(np.abs(v) < np.finfo(np.float64).eps, 0.0, v) for v in values)
    return cos, sin


def forward(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the pose X_BT (..., 4, 4) of the tool in the base; of the flange where `X_FT` is None."""
    X_BF = link_poses(robot, q)[..., 6, :, :]
    return X_BF if X_FT is None else X_BF @ np.asarray(X_FT, dtype=np.float64)


def jacobian(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the geometric Jacobian (..., 6, 6) of the tool in the base: linear [m/rad], then angular [1] rows."""
    X = link_poses(robot, q)
    axes, origins = (np.moveaxis(X[..., :6, :3, k], -1, 0) for k in (2, 3))
    J_v = cross(axes, np.moveaxis(_tool_point(X, X_FT), -1, 0)[..., None] - origins)
    return np.moveaxis(np.concatenate([J_v, axes]), 0, -2)


def _tool_point(X: Array, X_FT: ArrayLike | None) -> Array:
    """Returns the tool centre point (..., 3) for link poses."""
    p_BF = X[..., 6, :3, 3]
    return p_BF if X_FT is None else p_BF + X[..., 6, :3, :3] @ np.asarray(X_FT, dtype=np.float64)[:3, 3]


def analytical_jacobian(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the Jacobian (..., 6, 6) to the rates of position [m/rad] and rotation vector [1] of the tool.

    Valid for rotations of less than pi, where the rotation vector flips.
    """
    J = jacobian(robot, q, X_FT)
    vector = matrix_to_rotation_vector(forward(robot, q, X_FT)[..., :3, :3])
    J[..., 3:, :] = rotation_vector_rate(vector) @ J[..., 3:, :]
    return J


def tcp_acceleration(robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the acceleration J qdd + dJ/dt qd (..., 6) of the tool in the base, linear [m/s^2], then angular."""
    q, qd, qdd = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (q, qd, qdd)))
    X = link_poses(robot, q.reshape(-1, 6))
    links = LinkMotion(X, qd.reshape(-1, 6), qdd.reshape(-1, 6))
    tool = _tool_point(X, X_FT).T - links.origins[:, 6]
    points = np.concatenate([links.offsets, tool[:, None]], axis=1)
    linear = links.relative_acceleration(points, np.array([*range(6), 5])).sum(axis=1)
    return np.concatenate([linear, links.angular_acceleration[:, 5]]).T.reshape(q.shape)


def jacobian_dot_qd(robot: Robot, q: ArrayLike, qd: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns dJ/dt qd (..., 6), the acceleration of the tool without joint acceleration."""
    return tcp_acceleration(robot, q, qd, np.zeros(6), X_FT)
