"""Joint torques of a motion: Newton and Euler's equations for all links and samples at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.kinematics.chain import link_poses
from planner.kinematics.motion import LinkMotion, added_up, cross, dot
from planner.robots import Link, Robot

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

    Source: Luh, Walker and Paul 1980, for all links and samples at once in the frame of the base.
    """
    q, qd, qdd = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (q, qd, qdd)))
    rows = [x.reshape(-1, 6) for x in (q, qd, qdd)]
    chain = LinkMotion(link_poses(robot, rows[0]), rows[1], rows[2])
    return chain_torques(chain, bodies(robot, payload), gravity_B)[0].T.reshape(q.shape)


@dataclass(frozen=True, eq=False)
class Bodies:
    """The six links, a payload joined to the last.

    Attributes:
        mass: (6,) [kg].
        fixed: centre of mass [m] and the three principal axes, in the link's frame (4, 6, 3).
        principal: moments of inertia about these axes through the centre of mass (3, 6) [kg m2].
    """

    mass: Array
    fixed: Array
    principal: Array


def chain_torques(
    chain: LinkMotion, carried: Bodies, gravity: ArrayLike, p_F: Array | None = None
) -> tuple[Array, Array]:
    """Torques (6, N) [N m] of the bodies, and those of one more kilogram at the flange's point `p_F` (3,).

    Args:
        chain: how the links move.
        carried: what they weigh.
        gravity: acceleration of free fall (3,) in the chain's frame [m/s2].
        p_F: by default the flange's origin.
    """
    upward = -np.asarray(gravity, dtype=np.float64)[:, None]  # an arm at rest feels as if it accelerated upwards
    fixed = chain.fixed(carried.fixed)
    coms, axes = fixed[:, 0], fixed[:, 1:]
    extra = np.zeros((3, 1, coms.shape[2])) if p_F is None else (chain.on_flange(p_F) - chain.origins[:, 6])[:, None]
    relative = chain.relative_acceleration(np.concatenate([chain.arms, coms, extra], axis=1), _CARRIERS)
    origins = added_up(relative[:, :6]) + upward[:, None]
    force = carried.mass[:, None] * (origins + relative[:, 6:12])
    moment = _turning_moments(chain, axes, carried.principal) + cross(chain.origins[:, 1:] + coms, force)
    for v in (force, moment):
        added_up(v[:, ::-1])  # from the tip inwards: what each joint must bear
    tau = dot(chain.axes, moment - cross(chain.origins[:, :6], force))
    point = (chain.origins[:, 6] + extra[:, 0])[:, None] - chain.origins[:, :6]
    return tau, dot(chain.axes, cross(point, (origins[:, 5] + relative[:, 12])[:, None]))


_CARRIERS = np.array([*range(6), *range(6), 5])  # the links with which arms, centres of mass and the extra point move


def _turning_moments(chain: LinkMotion, axes: Array, principal: Array) -> Array:
    """Moments (3, 6, N) that turn the links about their centres of mass: I dw/dt + w x I w.

    Args:
        chain: how the links turn.
        axes: principal axes of the links (3, 3, 6, N), the second index counting them.
        principal: moments about them (3, 6).
    """
    both = np.stack([chain.spin_rate, chain.spin], axis=1)
    along = (axes[:, :, None] * both[:, None]).sum(axis=0) * principal[:, None, :, None]
    moments = (axes[:, :, None] * along).sum(axis=1)
    return moments[:, 0] + cross(chain.spin, moments[:, 1])


def bodies(robot: Robot, payload: Payload | None) -> Bodies:
    """The arm's links with the payload joined to the last."""
    links = robot.links if payload is None else (*robot.links[:5], _with_payload(robot.links[5], payload))
    mass, com, inertia = (np.array([getattr(link, name) for link in links]) for name in ("mass", "com", "inertia"))
    principal, axes = np.linalg.eigh(inertia)
    return Bodies(mass, np.stack([com, *axes.transpose(2, 0, 1)]), principal.T)


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
