"""Forward kinematics: link poses, tool pose, Jacobians and tool acceleration.

Frames: B arm base (DH frame 0), F flange (DH frame 6), T tool centre point. Everything is expressed in B and works
over leading dimensions `...` of q.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.kinematics.link_motion import LinkMotion
from planner.native import loops
from planner.robots import Robot
from planner.rotations import matrix_to_rotation_vector, rotation_vector_rate


def link_poses(robot: Robot, q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Returns the poses (..., 7, 4, 4) of the DH frames; index 0 is the base, 6 the flange.

    The z axis of each frame is the axis of the next joint, of a calibrated arm as well.

    Source: Denavit and Hartenberg, distal convention: Rot_z(q) Trans_z(d) Trans_x(a) Rot_x(alpha).

    Args:
        robot: the arm.
        q: joint positions (..., 6) [rad].
        X_WB: pose of the base (4, 4); the poses are in the base where it is None.
    """
    q = np.asarray(q, dtype=np.float64)
    rows = q.reshape(-1, 6)
    base = np.eye(4) if X_WB is None else np.asarray(X_WB, dtype=np.float64)
    if robot.fixed is not None:
        return loops.fixed_chain_poses(np.cos(rows), np.sin(rows), robot.fixed, base).reshape(*q.shape[:-1], 7, 4, 4)
    return loops.link_poses(np.cos(rows), np.sin(rows), _dh(robot), base).reshape(*q.shape[:-1], 7, 4, 4)


def flange_poses(robot: Robot, q: ArrayLike, X_WB: ArrayLike | None = None) -> Array:
    """Returns the poses (..., 4, 4) of the flange, the last of `link_poses`."""
    q = np.asarray(q, dtype=np.float64)
    rows = q.reshape(-1, 6)
    base = np.eye(4) if X_WB is None else np.asarray(X_WB, dtype=np.float64)
    if robot.fixed is not None:
        return loops.fixed_chain_poses(np.cos(rows), np.sin(rows), robot.fixed, base)[:, 6].reshape(*q.shape[:-1], 4, 4)
    return loops.flange_poses(np.cos(rows), np.sin(rows), _dh(robot), base).reshape(*q.shape[:-1], 4, 4)


@cache
def _dh(robot: Robot) -> Array:
    """Returns a, d, and cosine and sine of the DH twists (4, 6), exact at quarter turns, where floats leave 6e-17."""
    twists = np.array([np.cos(robot.alpha), np.sin(robot.alpha)])
    return np.array([robot.a, robot.d, *np.where(np.abs(twists) < np.finfo(np.float64).eps, 0.0, twists)])


def forward(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the pose X_BT (..., 4, 4) of the tool in the base; of the flange where `X_FT` is None."""
    X_BF = flange_poses(robot, q)
    return X_BF if X_FT is None else X_BF @ np.asarray(X_FT, dtype=np.float64)


def jacobian(robot: Robot, q: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns the geometric Jacobian (..., 6, 6) of the tool in the base: linear [m/rad], then angular [1] rows."""
    X = link_poses(robot, q)
    p_F = np.zeros(3) if X_FT is None else np.asarray(X_FT, dtype=np.float64)[:3, 3]
    return loops.jacobians(X.reshape(-1, 7, 4, 4), p_F).reshape(*X.shape[:-3], 6, 6)


def point_motion(robot: Robot, q: Array, p_F: Array) -> tuple[Array, Array]:
    """Returns positions (n, 3) [m] and linear Jacobians (n, 3, 6) [m/rad] of a point of the flange, in the base.

    Args:
        robot: the arm.
        q: joint positions (n, 6) [rad].
        p_F: the point in the flange (3,) [m].
    """
    X = link_poses(robot, q)
    return X[:, 6, :3, :3] @ p_F + X[:, 6, :3, 3], loops.jacobians(X, p_F)[:, :3]


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
    linear = links.acceleration(_tool_point(X, X_FT).T)
    return np.concatenate([linear, links.angular_acceleration[:, 5]]).T.reshape(q.shape)


def jacobian_dot_qd(robot: Robot, q: ArrayLike, qd: ArrayLike, X_FT: ArrayLike | None = None) -> Array:
    """Returns dJ/dt qd (..., 6), the acceleration of the tool without joint acceleration."""
    return tcp_acceleration(robot, q, qd, np.zeros(6), X_FT)
