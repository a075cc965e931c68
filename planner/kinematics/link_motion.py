"""Motion of the links over many samples: vectors (3, k, N), so that one call serves k links and N samples.

Everything is in the frame of the link poses given, the world or the base.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from planner.arrays import Array
from planner.native import loops


class LinkMotion:
    """Velocities and accelerations of the six links over N samples.

    Attributes:
        X: poses of base and links (N, 7, 4, 4).
        qd, qdd: joint rates (N, 6) [rad/s, rad/s^2].
    """

    def __init__(self, X: Array, qd: Array, qdd: Array) -> None:
        """Takes link poses (N, 7, 4, 4) of `link_poses` and joint rates (N, 6) [rad/s, rad/s^2]."""
        self.X = X
        self.qd = qd
        self.qdd = qdd

    @cached_property
    def axes(self) -> Array:
        """Directions of the joint axes (3, 6, N)."""
        return np.ascontiguousarray(self.X[:, :6, :3, 2].transpose(2, 1, 0))

    @cached_property
    def joint_rotations(self) -> Array:
        """Angular velocity that each joint contributes (3, 6, N) [rad/s]."""
        return self.axes * self.qd.T

    @cached_property
    def angular_velocity(self) -> Array:
        """Angular velocity of the links (3, 6, N) [rad/s]."""
        return accumulate(self.joint_rotations.copy())

    @cached_property
    def angular_acceleration(self) -> Array:
        """Angular acceleration of the links (3, 6, N) [rad/s^2]."""
        return accumulate(self.axes * self.qdd.T + cross(self.angular_velocity, self.joint_rotations))

    def on_flange(self, p_F: Array) -> Array:
        """Returns positions (3, N) [m] of a point (3,) of the flange."""
        flange = self.X[:, 6, :3]
        return (flange[:, :, :3] @ p_F + flange[:, :, 3]).T

    def velocity(self, point: Array) -> Array:
        """Returns velocities (3, N) [m/s] of a point (3, N) that moves with the flange."""
        return loops.point_velocity(self.X, self.qd, point)

    def acceleration(self, point: Array) -> Array:
        """Returns accelerations (3, N) [m/s^2] of a point (3, N) that moves with the flange."""
        return loops.point_acceleration(self.X, self.qd, self.qdd, point)


def accumulate(v: Array) -> Array:
    """Returns cumulative sums along the chain (3, k, N), in place; faster than `numpy.cumsum` along a middle axis."""
    for i in range(1, v.shape[1]):
        v[:, i] += v[:, i - 1]
    return v


def cross(a: Array, b: Array) -> Array:
    """Returns the cross product (3, ...) of vectors (3, ...)."""
    (a0, a1, a2) = a
    (b0, b1, b2) = b
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a1 * b2 - a2 * b1
    out[1] = a2 * b0 - a0 * b2
    out[2] = a0 * b1 - a1 * b0
    return out


def dot(a: Array, b: Array) -> Array:
    """Returns the dot product (...) of vectors (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
