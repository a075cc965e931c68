"""Joint torques of a motion: Newton and Euler's equations for all links and samples at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.kinematics.chain import twists
from planner.robots import Link, Robot
from planner.rotations import skew

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Payload:
    """What hangs on the flange F.

    Attributes:
        mass_kg: its mass [kg].
        com_F: centre of mass (3,) [m].
        inertia_F: inertia (3, 3) about the centre of mass, in the axes of the flange [kg m2].
    """

    mass_kg: float
    com_F: Array
    inertia_F: Array


def joint_torques(
    robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, gravity_B: ArrayLike, payload: Payload | None = None
) -> Array:
    """Torques (..., 6) [N m] at the joints that make the arm move so, without friction and rotor inertia.

    Args:
        q, qd, qdd: joint positions, velocities, accelerations (..., 6) [rad, rad/s, rad/s2].
        gravity_B: acceleration of free fall (3,) in the arm's base [m/s2]; (0, 0, -9.81) for an arm on the floor.
        payload: what the flange carries.

    Source: Luh, Walker and Paul 1980, in the DH link frames; one loop out along the arm, one back, over all samples.
    """
    states = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (q, qd, qdd)))
    angle, rate, acceleration = (x.reshape(-1, 6).T for x in states)
    turns = _Turns(robot, angle)
    spin, spin_rate = _spins(turns, rate, acceleration)
    arms = _arms(robot)
    upward = -np.asarray(gravity_B, dtype=np.float64)  # an arm at rest feels as if it accelerated upwards
    origins = _accelerations(turns, upward, _relative(spin, spin_rate, arms))
    mass, com, inertia = _bodies(robot, payload)
    force = mass[:, None, None] * (origins + _relative(spin, spin_rate, com))
    moment = inertia @ spin_rate + _cross(spin, inertia @ spin) + skew(com) @ force
    return _torques(turns, arms, force, moment).T.reshape(states[0].shape)


class _Turns:
    """Rotations between neighbouring link frames, for vectors (3, ..., N) of N samples."""

    def __init__(self, robot: Robot, angle: Array) -> None:
        self.cos, self.sin = np.cos(angle), np.sin(angle)
        self.c_alpha, self.s_alpha = twists(robot)

    def outward(self, i: int, v: Array) -> Array:
        """Vector of frame i seen in frame i + 1."""
        y = self.cos[i] * v[1] - self.sin[i] * v[0]
        c, s = self.c_alpha[i], self.s_alpha[i]
        out = np.empty_like(v)
        out[0] = self.cos[i] * v[0] + self.sin[i] * v[1]
        out[1], out[2] = c * y + s * v[2], c * v[2] - s * y
        return out

    def inward(self, i: int, v: Array) -> Array:
        """Vector of frame i + 1 seen in frame i."""
        c, s = self.c_alpha[i], self.s_alpha[i]
        y = c * v[1] - s * v[2]
        out = np.empty_like(v)
        out[0], out[1] = self.cos[i] * v[0] - self.sin[i] * y, self.sin[i] * v[0] + self.cos[i] * y
        out[2] = s * v[1] + c * v[2]
        return out


def _spins(turns: _Turns, rate: Array, acceleration: Array) -> tuple[Array, Array]:
    """Angular velocity and acceleration (6, 3, N) of the links, each in its own frame."""
    both, out = np.zeros((3, 2, rate.shape[1])), np.empty((6, 3, 2, rate.shape[1]))
    for i in range(6):
        both[0, 1] += both[1, 0] * rate[i]
        both[1, 1] -= both[0, 0] * rate[i]
        both[2, 0] += rate[i]
        both[2, 1] += acceleration[i]
        both = turns.outward(i, both)
        out[i] = both
    return np.ascontiguousarray(out[:, :, 0]), np.ascontiguousarray(out[:, :, 1])


def _relative(spin: Array, spin_rate: Array, points: Array) -> Array:
    """Acceleration (6, 3, N) of a point (6, 3) fixed in each link, relative to the origin of the link's frame."""
    across = -skew(points)
    return across @ spin_rate + _cross(spin, across @ spin)


def _accelerations(turns: _Turns, upward: Array, relative: Array) -> Array:
    """Acceleration (6, 3, N) of the origin of every link frame, in that frame, from one link to the next."""
    out = np.empty_like(relative)
    before = np.repeat(upward[:, None], relative.shape[-1], axis=1)
    for i in range(6):
        before = turns.outward(i, before) + relative[i]
        out[i] = before
    return out


def _torques(turns: _Turns, arms: Array, force: Array, moment: Array) -> Array:
    """Torques (6, N): forces and moments (6, 3, N) about the link origins added up from the tip inwards."""
    tau, both = np.empty((6, force.shape[-1])), np.zeros((3, 2, force.shape[-1]))
    lever = skew(arms)
    for i in reversed(range(6)):
        both[:, 0] += force[i]
        both[:, 1] += moment[i] + lever[i] @ both[:, 0]
        both = turns.inward(i, both)
        tau[i] = both[2, 1]
    return tau


def _arms(robot: Robot) -> Array:
    """Origin of each link frame from the joint that moves it (6, 3), in the link's frame: constant."""
    c_alpha, s_alpha = twists(robot)
    return np.stack([robot.a, robot.d * s_alpha, robot.d * c_alpha], axis=-1)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (6, 3, N)."""
    out = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out


def _bodies(robot: Robot, payload: Payload | None) -> tuple[Array, Array, Array]:
    """Masses (6,), centres of mass (6, 3) and inertias about them (6, 3, 3), the payload joined to the last link."""
    links = robot.links if payload is None else (*robot.links[:5], _with_payload(robot.links[5], payload))
    mass = np.array([link.mass for link in links])
    return mass, np.array([link.com for link in links]), np.array([link.inertia for link in links])


def _with_payload(link: Link, payload: Payload) -> Link:
    """The flange's link and the payload as one body. Source: parallel axis theorem."""
    if payload.mass_kg == 0.0:
        return link
    mass = link.mass + payload.mass_kg
    com = (link.mass * link.com + payload.mass_kg * payload.com_F) / mass
    inertia = link.inertia + payload.inertia_F
    for part, centre in ((link.mass, link.com - com), (payload.mass_kg, payload.com_F - com)):
        inertia = inertia + part * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return Link(link.name, mass, com, inertia)
