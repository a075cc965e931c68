"""Poses, velocities and torques of an arm: numpy twins of planner/native/kernel/arm.c and of Jacobians."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from planner.arrays import Array, Index
from planner.kinematics import LinkMotion, accumulate, cross, dot

# Links with which the origins of their frames move, and a point of the flange; the same with the centres of mass.
CARRIERS = np.array([*range(6), 5])
LOAD_CARRIERS = np.array([*range(6), *range(6), 5])


class Chain(LinkMotion):
    """Link motion with what the compiled functions need in between: origins and frames of the links."""

    @cached_property
    def origins(self) -> Array:
        """Origins of the DH frames 0 to 6 (3, 7, N) [m]."""
        return np.ascontiguousarray(self.X[:, :, :3, 3].transpose(2, 1, 0))

    @cached_property
    def frames(self) -> Array:
        """Directions of x, y and z of the DH frames 1 to 6 (3, 3, 6, N); the first index counts x, y, z."""
        return np.ascontiguousarray(self.X[:, 1:, :3, :3].transpose(3, 2, 1, 0))

    @cached_property
    def offsets(self) -> Array:
        """Origin of each link's frame from that of the one before it (3, 6, N) [m]."""
        return self.origins[:, 1:] - self.origins[:, :-1]

    @cached_property
    def origin_velocities(self) -> Array:
        """Velocities of the origins of the DH frames 1 to 6 (3, 6, N) [m/s]."""
        return accumulate(cross(self.angular_velocity, self.offsets))

    def in_links(self, vectors: Array) -> Array:
        """Returns directions now (3, k, 6, N) of vectors (k, 6, 3), k of them fixed in the frame of each link."""
        x, y, z = self.frames[:, :, None]
        along_x, along_y, along_z = vectors.transpose(2, 0, 1)[..., None]
        return x * along_x + y * along_y + z * along_z

    def relative_acceleration(self, points: Array, link: Index) -> Array:
        """Returns accelerations (3, k, N) [m/s^2] of points relative to the origins of their links.

        Args:
            points: from these origins (3, k, N) [m].
            link: index of the link with which each moves (k,).
        """
        omega = self.angular_velocity[:, link]
        alpha = self.angular_acceleration[:, link]
        return cross(alpha, points) + cross(omega, cross(omega, points))


def link_poses(cosine: Array, sine: Array, dh: Array, base: Array) -> Array:
    """Returns link poses (n, 7, 4, 4) for cosines and sines (n, 6) of the joint positions."""
    cos = np.ascontiguousarray(cosine.T)
    sin = np.ascontiguousarray(sine.T)
    x, y, z, p = (np.repeat(base[:3, k, None], cos.shape[1], axis=1) for k in range(4))
    X = np.zeros((cos.shape[1], 7, 4, 4))
    X[:, 0] = base
    X[:, 1:, 3, 3] = 1.0
    for i, (a, d, c_alpha, s_alpha) in enumerate(dh.T):
        turned = cos[i] * y - sin[i] * x
        x = cos[i] * x + sin[i] * y
        if d != 0.0:
            p = p + d * z
        if a != 0.0:
            p = p + a * x
        if c_alpha == 1.0:
            y = turned
        else:
            y = c_alpha * turned + s_alpha * z
            z = c_alpha * z - s_alpha * turned
        for column, vector in enumerate((x, y, z, p)):
            X[:, i + 1, :3, column] = vector.T
    return X


def flange_poses(cosine: Array, sine: Array, dh: Array, base: Array) -> Array:
    """Returns flange poses (n, 4, 4) for cosines and sines (n, 6) of the joint positions."""
    return link_poses(cosine, sine, dh, base)[:, 6]


def fixed_chain_poses(cosine: Array, sine: Array, fixed: Array, base: Array) -> Array:
    """Returns link poses (n, 7, 4, 4) of a measured chain: X_i = X_(i-1) Rz(q_i) M_i with `fixed` M (6, 4, 4)."""
    X = np.empty((len(cosine), 7, 4, 4))
    X[:, 0] = base
    for i, M in enumerate(fixed):
        turned = X[:, i].copy()
        x = X[:, i, :, 0]
        y = X[:, i, :, 1]
        c = cosine[:, i, None]
        s = sine[:, i, None]
        turned[:, :, 0] = c * x + s * y
        turned[:, :, 1] = c * y - s * x
        X[:, i + 1] = turned @ M
    return X


def jacobians(X: Array, p_F: Array) -> Array:
    """Returns the Jacobians (n, 6, 6) of a point `p_F` (3,) of the flange for link poses."""
    axes, origins = (X[:, :6, :3, k].transpose(2, 0, 1) for k in (2, 3))
    point = X[:, 6, :3, 3] + X[:, 6, :3, :3] @ p_F
    return np.concatenate([cross(axes, point.T[..., None] - origins), axes]).transpose(1, 0, 2)


def end_points(X_WL: Array, frames: Index, ends: Array) -> Array:
    """Returns the ends in the world (k, 2, 3, n) of segments with `ends` (k, 2, 3) in `frames` (k,) of the poses."""
    X = X_WL[:, frames, :3].transpose(1, 3, 2, 0)
    rotated = ends @ X[:, :3].reshape(len(frames), 3, -1)
    return (rotated + X[:, 3].reshape(len(frames), 1, -1)).reshape(len(frames), 2, 3, -1)


def end_points_of(X_WL: Array, frames: Index, ends: Array) -> Array:
    """Returns the ends in the world (n, 2, 3) of one segment a sample, with `ends` (n, 2, 3) in `frames` (n,)."""
    X = X_WL[np.arange(len(frames)), frames]
    return np.matmul(ends, np.swapaxes(X[:, :3, :3], -1, -2)) + X[:, None, :3, 3]


def point_velocity(X: Array, qd: Array, point: Array) -> Array:
    """Returns velocities (3, n) of a point (3, n) that moves with the flange."""
    links = Chain(X, qd, qd)
    return cross(links.joint_rotations, point[:, None] - links.origins[:, :6]).sum(axis=1)


def point_acceleration(X: Array, qd: Array, qdd: Array, point: Array) -> Array:
    """Returns accelerations (3, n) of a point (3, n) that moves with the flange."""
    links = Chain(X, qd, qdd)
    points = np.concatenate([links.offsets, (point - links.origins[:, 6])[:, None]], axis=1)
    return links.relative_acceleration(points, CARRIERS).sum(axis=1)


def fastest(X: Array, qd: Array, frames: Index, places: Array) -> Array:
    """Returns speeds (n,) of the fastest of points at `places` (k, 3) of `frames` (k,)."""
    speeds = []
    for frame, place in zip(frames, places, strict=True):
        point = X[:, frame, :3, :3] @ place + X[:, frame, :3, 3]
        speeds.append(np.linalg.norm(point_velocity(X, qd * (np.arange(6) < frame), point.T), axis=0))
    return np.max(speeds, axis=0)


def momentum(X: Array, qd: Array, mass: Array, coms: Array) -> Array:
    """Returns the linear momentum (3, n) of links of `mass` (6,) with centres of mass `coms` (6, 3) in them."""
    chain = Chain(X, qd, qd)
    velocities = chain.origin_velocities + cross(chain.angular_velocity, chain.in_links(coms[None])[:, 0])
    return (mass[:, None] * velocities).sum(axis=1)


def chain_torques(
    X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
) -> Array:
    """Returns torques (2, 6, n) of the links, and per kilogram at `p_F` of the flange, by Newton and Euler."""
    mass, fixed, principal = bodies
    chain = Chain(X, *rates)
    turned = chain.in_links(fixed)
    coms = turned[:, 0]
    axes = turned[:, 1:]
    extra = (chain.on_flange(p_F) - chain.origins[:, 6])[:, None]
    relative = chain.relative_acceleration(np.concatenate([chain.offsets, coms, extra], axis=1), LOAD_CARRIERS)
    origins = accumulate(relative[:, :6]) + upward[:, None, None]
    force = mass[:, None] * (origins + relative[:, 6:12])
    moment = _turning_moments(chain, axes, principal) + cross(chain.origins[:, 1:] + coms, force)
    for v in (force, moment):
        accumulate(v[:, ::-1])  # from the tip inwards: the load on each joint
    tau = dot(chain.axes, moment - cross(chain.origins[:, :6], force))
    point = (chain.origins[:, 6] + extra[:, 0])[:, None] - chain.origins[:, :6]
    return np.array([tau, dot(chain.axes, cross(point, (origins[:, 5] + relative[:, 12])[:, None]))])


def torque_terms(
    X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
) -> Array:
    """Returns torques (3, 2, 6, n): of the motion, without joint accelerations, and M qd with the mass matrix M."""
    qd, qdd = rates
    still = np.zeros_like(qd)
    return np.array(
        [
            chain_torques(X, (qd, qdd), bodies, upward, p_F),
            chain_torques(X, (qd, still), bodies, upward, p_F),
            chain_torques(X, (still, qd), bodies, np.zeros(3), p_F),
        ]
    )


def _turning_moments(chain: LinkMotion, axes: Array, principal: Array) -> Array:
    """Returns the moments (3, 6, N) [N m] on the links about their centres of mass: I dw/dt + w x I w.

    Args:
        chain: motion of the links.
        axes: principal axes of the links (3, 3, 6, N); the second index counts them.
        principal: moments of inertia about them (3, 6) [kg m^2].
    """
    both = np.stack([chain.angular_acceleration, chain.angular_velocity], axis=1)
    along = (axes[:, :, None] * both[:, None]).sum(axis=0) * principal[:, None, :, None]
    moments = (axes[:, :, None] * along).sum(axis=1)
    return moments[:, 0] + cross(chain.angular_velocity, moments[:, 1])
