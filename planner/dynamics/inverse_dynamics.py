"""Inverse dynamics: joint torques of a motion by the recursive Newton-Euler equations, for all samples at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.cell import Cell, ThrownBody
from planner.kinematics import LinkMotion, link_poses
from planner.native import loops
from planner.robots import Link, Robot


@dataclass(frozen=True, eq=False)
class Payload:
    """Load on the flange F.

    Attributes:
        mass_kg: its mass [kg].
        com_F: centre of mass (3,) [m].
        inertia_F: inertia (3, 3) about the centre of mass, in the axes of the flange [kg m^2].
    """

    mass_kg: float
    com_F: Array
    inertia_F: Array


def payload_of(cell: Cell, with_object: bool) -> Payload:
    """Returns the tool of a cell, its mass half way to the end of the hand, and the object with its inertia if held.

    The object's centre is the tool centre point. A ball counts as a point.
    """
    p_FT = cell.tool.X_FT[:3, 3]
    beyond = p_FT - cell.tool.end_F  # of the object's centre from the end of the hand; none but for `object.in_tool`
    tool_kg = cell.tool.mass_kg
    object_kg = cell.object.mass_kg if with_object else 0.0
    if cell.carried:
        return _with_carried(cell, object_kg)
    mass = tool_kg + object_kg
    if mass == 0.0:
        return Payload(0.0, np.zeros(3), np.zeros((3, 3)))
    com = (0.5 * tool_kg + object_kg) / mass * p_FT - 0.5 * tool_kg / mass * beyond
    twice = p_FT + beyond  # from the tool's centre of mass to the object's
    apart = tool_kg * object_kg / mass * 0.25  # two points half of that apart, about their common centre
    inertia = apart * (twice @ twice * np.eye(3) - np.outer(twice, twice))
    if with_object and isinstance(cell.object, ThrownBody):
        R_FO = cell.tool.X_FT[:3, :3] @ cell.object.R_TO
        inertia = inertia + R_FO * cell.object.inertia_kg_m2 @ R_FO.T
    return Payload(mass, com, inertia)


def _with_carried(cell: Cell, object_kg: float) -> Payload:
    """Returns the tool, its object and what its other grippers hold, each a point, as one body."""
    tool = cell.tool
    masses = np.array([tool.mass_kg, object_kg, *(each.mass_kg for each in cell.carried)])
    places = np.array([0.5 * tool.end_F, tool.X_FT[:3, 3], *(each.p_F for each in cell.carried)])
    mass = float(masses.sum())
    com = masses @ places / mass
    off = places - com
    squares = (masses[:, None] * off).T @ off
    return Payload(mass, com, np.trace(squares) * np.eye(3) - squares)


def gravity_in_base(cell: Cell) -> Array:
    """Returns the acceleration of free fall (3,) [m/s^2] in the arm's base."""
    return cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])


def joint_torques(
    robot: Robot, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, gravity_B: ArrayLike, payload: Payload | None = None
) -> Array:
    """Returns the joint torques (..., 6) [N m] of a motion, without friction and rotor inertia.

    Source: Luh, Walker and Paul 1980, for all links and samples at once in the frame of the base.

    Args:
        robot: the arm.
        q, qd, qdd: joint positions, velocities, accelerations (..., 6) [rad, rad/s, rad/s^2].
        gravity_B: acceleration of free fall (3,) in the arm's base [m/s^2]; (0, 0, -9.81) for an arm on the floor.
        payload: load on the flange; none by default.
    """
    q, qd, qdd = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (q, qd, qdd)))
    rows = [x.reshape(-1, 6) for x in (q, qd, qdd)]
    chain = LinkMotion(link_poses(robot, rows[0]), rows[1], rows[2])
    return chain_torques(chain, bodies(robot, payload), gravity_B)[0].T.reshape(q.shape)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Mass properties of the six links, a payload joined to the last.

    Attributes:
        mass: (6,) [kg].
        fixed: centre of mass [m] and the three principal axes, in the link's frame (4, 6, 3).
        principal: moments of inertia about these axes through the centre of mass (3, 6) [kg m^2].
    """

    mass: Array
    fixed: Array
    principal: Array

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """All three."""
        return self.mass, self.fixed, self.principal


def chain_torques(chain: LinkMotion, carried: Bodies, gravity: ArrayLike, p_F: Array | None = None) -> Array:
    """Returns torques (2, 6, N) [N m] of the bodies, and per kilogram of a point mass on the flange [N m/kg].

    Args:
        chain: motion of the links.
        carried: their mass properties.
        gravity: acceleration of free fall (3,) in the frame of `chain` [m/s^2].
        p_F: place of the point mass on the flange (3,) [m]; its origin by default.
    """
    upward = -np.asarray(gravity, dtype=np.float64)  # gravity acts as an upward acceleration of the base
    place = np.zeros(3) if p_F is None else p_F
    return loops.chain_torques(chain.X, (chain.qd, chain.qdd), carried.arrays, upward, place)


class TorqueTerms(NamedTuple):
    """Joint torques and what they consist of: (6, N) each, of the bodies, and per kilogram of a point mass.

    Attributes:
        whole: of the motion [N m] and [N m/kg].
        held: of gravity and velocity, without joint accelerations [N m] and [N m/kg].
        momentum: M qd with the mass matrix M [N m s] and [N m s/kg].
    """

    whole: Array
    held: Array
    momentum: Array


def torque_terms(chain: LinkMotion, carried: Bodies, gravity: ArrayLike, p_F: Array) -> TorqueTerms:
    """Returns the torques of `chain_torques` with their terms (2, 6, N) each."""
    upward = -np.asarray(gravity, dtype=np.float64)
    return TorqueTerms(*loops.torque_terms(chain.X, (chain.qd, chain.qdd), carried.arrays, upward, p_F))


def bodies(robot: Robot, payload: Payload | None) -> Bodies:
    """Returns the arm's links with the payload joined to the last."""
    links = robot.links if payload is None else (*robot.links[:5], _with_payload(robot.links[5], payload))
    mass, com, inertia = (np.array([getattr(link, name) for link in links]) for name in ("mass", "com", "inertia"))
    principal, axes = np.linalg.eigh(inertia)
    return Bodies(mass, np.stack([com, *axes.transpose(2, 0, 1)]), principal.T)


def _with_payload(link: Link, payload: Payload) -> Link:
    """Returns the flange's link and the payload as one body. Source: parallel axis theorem."""
    if payload.mass_kg == 0.0:
        return link
    mass = link.mass + payload.mass_kg
    com = (link.mass * link.com + payload.mass_kg * payload.com_F) / mass
    inertia = link.inertia + payload.inertia_F
    for part, centre in ((link.mass, link.com - com), (payload.mass_kg, payload.com_F - com)):
        inertia = inertia + part * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return Link(link.name, mass, com, inertia)
