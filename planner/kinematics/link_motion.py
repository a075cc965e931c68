"""Motion of the links over many samples: vectors (3, k, N), so that one call serves k links and N samples.

Everything is in the frame of the link poses given, the world or the base.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from planner import native
from planner.arrays import Array, Index


class LinkMotion:
    """Axes, origins, velocities and accelerations of the six links over N samples.

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
    def origins(self) -> Array:
        """Origins of the DH frames 0 to 6 (3, 7, N) [m]."""
        return np.ascontiguousarray(self.X[:, :, :3, 3].transpose(2, 1, 0))

    @cached_property
    def frames(self) -> Array:
        """Directions of x, y and z of the DH frames 1 to 6 (3, 3, 6, N); the first index counts x, y, z."""
        return np.ascontiguousarray(self.X[:, 1:, :3, :3].transpose(3, 2, 1, 0))

    @cached_property
    def joint_rotations(self) -> Array:
        """Angular velocity that each joint contributes (3, 6, N) [rad/s]."""
        return self.axes * self.qd.T

    @cached_property
    def offsets(self) -> Array:
        """Origin of each link's frame from that of the one before it (3, 6, N) [m]."""
        return self.origins[:, 1:] - self.origins[:, :-1]

    @cached_property
    def angular_velocity(self) -> Array:
        """Angular velocity of the links (3, 6, N) [rad/s]."""
        return accumulate(self.joint_rotations.copy())

    @cached_property
    def origin_velocities(self) -> Array:
        """Velocities of the origins of the DH frames 1 to 6 (3, 6, N) [m/s]."""
        return accumulate(cross(self.angular_velocity, self.offsets))

    @cached_property
    def angular_acceleration(self) -> Array:
        """Angular acceleration of the links (3, 6, N) [rad/s^2]."""
        return accumulate(self.axes * self.qdd.T + cross(self.angular_velocity, self.joint_rotations))

    def in_links(self, vectors: Array) -> Array:
        """Returns directions now (3, k, 6, N) of vectors (k, 6, 3), k of them fixed in the frame of each link."""
        x, y, z = self.frames[:, :, None]
        along_x, along_y, along_z = vectors.transpose(2, 0, 1)[..., None]
        return x * along_x + y * along_y + z * along_z

    def on_flange(self, p_F: Array) -> Array:
        """Returns positions (3, N) [m] of a point (3,) of the flange."""
        flange = self.X[:, 6, :3]
        return (flange[:, :, :3] @ p_F + flange[:, :, 3]).T

    def velocity(self, point: Array) -> Array:
        """Returns velocities (3, N) [m/s] of a point (3, N) that moves with the flange."""
        return native.point_velocity(self.X, self.qd, point)

    def acceleration(self, point: Array) -> Array:
        """Returns accelerations (3, N) [m/s^2] of a point (3, N) that moves with the flange."""
        return native.point_acceleration(self.X, self.qd, self.qdd, point)

    def relative_acceleration(self, points: Array, link: Index) -> Array:
        """Returns accelerations (3, k, N) [m/s^2] of points relative to the origins of their links.

        Args:
            points: from these origins (3, k, N) [m].
            link: index of the link with which each moves (k,).
        """
        omega = self.angular_velocity[:, link]
        alpha = self.angular_acceleration[:, link]
        return cross(alpha, points) + cross(omega, cross(omega, points))


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
