"""How links and tool move, over many samples: vectors (3, k, N), so that one call serves k links and N samples.

Everything is in the frame in which the link poses are given, the world or the base.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LinkMotion:
    """Axes, origins, turning and accelerations of the six links of N samples.

    Attributes:
        axes: directions of the joints' axes (3, 6, N).
        origins: of the DH frames 0 to 6 (3, 7, N) [m].
        frames: directions of x, y and z of the DH frames 1 to 6 (3, 3, 6, N), the axis first.
        turns: angular velocity that each joint adds (3, 6, N) [rad/s].
    """

    def __init__(self, X: Array, qd: Array, qdd: Array) -> None:
        """From link poses (N, 7, 4, 4) of `link_poses` and joint rates (N, 6) [rad/s, rad/s2]."""
        self.axes = np.ascontiguousarray(X[:, :6, :3, 2].transpose(2, 1, 0))
        self.origins = np.ascontiguousarray(X[:, :, :3, 3].transpose(2, 1, 0))
        self.frames = np.ascontiguousarray(X[:, 1:, :3, :3].transpose(3, 2, 1, 0))
        self.turns = self.axes * qd.T
        self._qdd = qdd.T

    @cached_property
    def arms(self) -> Array:
        """Each link's frame from the one before it (3, 6, N) [m]."""
        return self.origins[:, 1:] - self.origins[:, :-1]

    @cached_property
    def spin(self) -> Array:
        """Angular velocity of the links (3, 6, N) [rad/s]."""
        return added_up(self.turns.copy())

    @cached_property
    def spin_rate(self) -> Array:
        """Angular acceleration of the links (3, 6, N) [rad/s2]."""
        return added_up(self.axes * self._qdd + cross(self.spin, self.turns))

    def fixed(self, vectors: Array) -> Array:
        """Vectors (k, 6, 3), k of them fixed in each link's frame, as they point now (3, k, 6, N)."""
        x, y, z = self.frames[:, :, None]
        along_x, along_y, along_z = vectors.transpose(2, 0, 1)[..., None]
        return x * along_x + y * along_y + z * along_z

    def on_flange(self, p_F: Array) -> Array:
        """Point (3,) of the flange (3, N) [m]."""
        x, y, z = self.frames[:, :, 5]
        return self.origins[:, 6] + x * p_F[0] + y * p_F[1] + z * p_F[2]

    def velocity(self, point: Array) -> Array:
        """Velocity (3, N) [m/s] of a point (3, N) that moves with the flange."""
        return cross(self.turns, point[:, None] - self.origins[:, :6]).sum(axis=1)

    def relative_acceleration(self, points: Array, link: NDArray[np.intp]) -> Array:
        """Acceleration (3, k, N) of points (3, k, N) from the origins of the links (k,) they move with, to these."""
        spin, spin_rate = self.spin[:, link], self.spin_rate[:, link]
        return cross(spin_rate, points) + cross(spin, cross(spin, points))


def added_up(v: Array) -> Array:
    """Sums along the chain (3, k, N), in place; quicker than `numpy.cumsum` along a middle axis."""
    for i in range(1, v.shape[1]):
        v[:, i] += v[:, i - 1]
    return v


def cross(a: Array, b: Array) -> Array:
    """Cross product (3, ...) of vectors (3, ...)."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a1 * b2 - a2 * b1
    out[1] = a2 * b0 - a0 * b2
    out[2] = a0 * b1 - a1 * b0
    return out


def dot(a: Array, b: Array) -> Array:
    """Scalar product (...) of vectors (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
