"""The arm over pieces of a motion: poses, speeds, accelerations, torques, momentum, as Taylor models.

The chain is X_WB Rz(q1) M_1 Rz(q2) M_2 ... with the fixed transforms M_i of a calibrated arm, or those of the published
Denavit-Hartenberg table, whose twists are quarter turns. The recursion of Newton and Euler is that of Luh, Walker and
Paul (1980), in the axes of the world.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.elementary import Array
from verifier.pieces import Pieces
from verifier.taylor import TaylorModel, constant, cross, dot, stacked, turned, turned_back

JOINTS = 6
QUARTERS = (1, 0, 0, 1, -1, 0)  # twists of every arm in quarter turns. source: Universal Robots, DH parameters


def fixed_transforms(cell: Cell) -> tuple[Array, Array]:
    """Returns rotations (6, 3, 3) and shifts (6, 3) [m] between the joints' rotations; quarter turns are exact."""
    robot = cell.robot
    if robot.fixed is not None:
        return robot.fixed[:, :3, :3], robot.fixed[:, :3, 3]
    turns = {
        0: np.eye(3),
        1: np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        -1: np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    }
    shifts = np.column_stack([robot.a, np.zeros(JOINTS), robot.d])
    return np.array([turns[quarter] for quarter in QUARTERS]), shifts


class Mass(NamedTuple):
    """A rigid body fixed in a frame: mass [kg], centre (3,) [m] and inertia about that (3, 3) [kg m^2] in its axes."""

    frame: int
    kg: float
    centre: Array
    inertia: Array


def empty_masses(cell: Cell) -> list[Mass]:
    """Returns links and tool; the tool's mass is half way to the end of the hand (docs/conventions.md)."""
    links = [Mass(i, link.mass, link.com, link.inertia) for i, link in enumerate(cell.robot.links, start=1)]
    return [*links, Mass(JOINTS, cell.tool.mass_kg, 0.5 * cell.tool.end_F, np.zeros((3, 3)))]


def object_mass(cell: Cell) -> Mass:
    """Returns the held object: a ball is a point mass, a body has its inertia."""
    inertia = np.zeros((3, 3))
    thing = cell.object
    if isinstance(thing, ThrownBody):
        R_FO = cell.tool.X_FT[:3, :3] @ thing.R_TO
        inertia = R_FO * thing.inertia_kg_m2 @ R_FO.T
    return Mass(JOINTS, thing.mass_kg, cell.tool.X_FT[:3, 3], inertia)


@dataclass(frozen=True, eq=False)
class ArmPieces:
    """A cell's arm over pieces of a motion.

    Attributes:
        cell: the cell.
        pieces: the pieces.
    """

    cell: Cell
    pieces: Pieces

    @cached_property
    def poses(self) -> list[tuple[TaylorModel, TaylorModel]]:
        """Rotations (3, 3, n) and origins (3, n) [m] of base and links in the world: seven."""
        q, _, _ = self.pieces.joints
        s, c = q.sine_cosine()
        turns, shifts = fixed_transforms(self.cell)
        X = self.cell.X_WB
        R = constant(X[:3, :3, None], q)
        p = constant(X[:3, 3, None], q)
        found = [(R, p)]
        for i in range(JOINTS):
            x = R[:, 0] * c[i] + R[:, 1] * s[i]
            y = R[:, 1] * c[i] - R[:, 0] * s[i]
            z = R[:, 2]
            p = p + _combined(x, y, z, shifts[i])
            columns = [_combined(x, y, z, turns[i][:, k]) for k in range(3)]
            R = TaylorModel(*(np.stack([getattr(m, name) for m in columns], axis=1) for name in TaylorModel.__slots__))
            found.append((R, p))
        return found

    def point(self, frame: int, place: Array) -> TaylorModel:
        """Returns a point (3, n) [m] in the world that is fixed in a frame at a place (3,) [m]."""
        R, p = self.poses[frame]
        return p + turned(R, place)

    @cached_property
    def turning(self) -> list[tuple[TaylorModel, TaylorModel]]:
        """Angular velocities and accelerations (3, n) [rad/s, rad/s^2] of base and links: seven."""
        return self._turning(*self.pieces.joints[1:])

    def _turning(self, qd: TaylorModel, qdd: TaylorModel) -> list[tuple[TaylorModel, TaylorModel]]:
        zero = qd[:3] * 0.0
        w, wd = zero, zero
        found = [(w, wd)]
        for i in range(JOINTS):
            z = self.poses[i][0][:, 2]
            spin = z * qd[i]
            wd = wd + z * qdd[i] + cross(w, spin)
            w = w + spin
            found.append((w, wd))
        return found

    @cached_property
    def moving(self) -> list[tuple[TaylorModel, TaylorModel]]:
        """Velocities and accelerations (3, n) [m/s, m/s^2] of the origins of base and links: seven."""
        zero = self.poses[0][1] * 0.0
        v, a = zero, zero
        found = [(v, a)]
        for i in range(1, JOINTS + 1):
            w, wd = self.turning[i]
            r = self.poses[i][1] - self.poses[i - 1][1]
            along = cross(w, r)
            v = v + along
            a = a + cross(wd, r) + cross(w, along)
            found.append((v, a))
        return found

    def velocity(self, frame: int, place: Array) -> TaylorModel:
        """Returns the velocity (3, n) [m/s] of a point that is fixed in a frame at a place (3,) [m]."""
        return self.moving[frame][0] + cross(self.turning[frame][0], turned(self.poses[frame][0], place))

    def acceleration(self, frame: int, place: Array) -> TaylorModel:
        """Returns its acceleration (3, n) [m/s^2]."""
        w, wd = self.turning[frame]
        r = turned(self.poses[frame][0], place)
        return self.moving[frame][1] + cross(wd, r) + cross(w, cross(w, r))

    @cached_property
    def p_WT(self) -> TaylorModel:
        """The tool centre point (3, n) [m]."""
        return self.point(JOINTS, self.cell.tool.X_FT[:3, 3])

    @cached_property
    def v_WT(self) -> TaylorModel:
        """Its velocity (3, n) [m/s]."""
        return self.velocity(JOINTS, self.cell.tool.X_FT[:3, 3])

    @cached_property
    def a_WT(self) -> TaylorModel:
        """Its acceleration (3, n) [m/s^2]."""
        return self.acceleration(JOINTS, self.cell.tool.X_FT[:3, 3])

    @cached_property
    def R_WT(self) -> TaylorModel:
        """Axes of the tool in the world (3, 3, n)."""
        return self.axes(self.cell.tool.X_FT[:3, :3])

    def axes(self, R_FT: Array) -> TaylorModel:
        """Returns axes (3, 3, n) in the world that are fixed in the flange."""
        R, _ = self.poses[JOINTS]
        columns = [turned(R, R_FT[:, k]) for k in range(3)]
        return TaylorModel(*(np.stack([getattr(m, name) for m in columns], axis=1) for name in TaylorModel.__slots__))

    def torques(self, masses: list[Mass]) -> TaylorModel:
        """Returns the joint torques (6, n) [N m] that move masses against gravity."""
        up = np.array([0.0, 0.0, self.cell.surroundings.gravity_m_s2])[:, None]
        forces = [(self._inertial(mass, up), mass.frame) for mass in masses]
        return self._about_joints(forces)

    def joint_momenta(self, masses: list[Mass]) -> TaylorModel:
        """Returns the mass matrix times the joint velocities (6, n) [N m s]."""
        found = []
        for mass in masses:
            v = self.velocity(mass.frame, mass.centre)
            found.append(((self.point(mass.frame, mass.centre), v * mass.kg, self._angular(mass, 0)), mass.frame))
        return self._about_joints(found)

    def momentum(self, masses: list[Mass]) -> TaylorModel:
        """Returns the linear momentum (3, n) [kg m/s]."""
        terms = [self.velocity(mass.frame, mass.centre) * mass.kg for mass in masses]
        found = terms[0]
        for term in terms[1:]:
            found = found + term
        return found

    def at_no_acceleration(self) -> ArmPieces:
        """Returns the arm as it would be with the joints' accelerations 0: its torques are gravity's and velocity's."""
        return _Coasting(self.cell, self.pieces)

    def _angular(self, mass: Mass, derivative: int) -> TaylorModel:
        """Returns the inertia times angular velocity, or acceleration (3, n)."""
        R, _ = self.poses[mass.frame]
        in_body = turned_back(R, self.turning[mass.frame][derivative])
        rows = [dot(row[:, None], in_body) for row in mass.inertia]
        return turned(R, stacked(rows))

    def _inertial(self, mass: Mass, up: Array) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
        """Returns where a mass is (3, n) [m], and the force [N] and moment [N m] about its centre that move it."""
        force = (self.acceleration(mass.frame, mass.centre) + up) * mass.kg
        moment = self._angular(mass, 1)
        if mass.inertia.any():
            moment = moment + cross(self.turning[mass.frame][0], self._angular(mass, 0))
        return self.point(mass.frame, mass.centre), force, moment

    def _about_joints(self, loads: list[tuple[tuple[TaylorModel, TaylorModel, TaylorModel], int]]) -> TaylorModel:
        """Returns moments about the joints' axes (6, n) of loads: place, force and moment, and the frame of each."""
        force = self.poses[0][1] * 0.0
        moment = force
        rows: list[TaylorModel] = []
        for i in range(JOINTS, 0, -1):
            pivot = self.poses[i - 1][1]
            moment = moment + cross(self.poses[i][1] - pivot, force)
            for (place, f, n), frame in loads:
                if frame == i:
                    moment = moment + n + cross(place - pivot, f)
                    force = force + f
            rows.append(dot(self.poses[i - 1][0][:, 2], moment))
        return stacked(rows[::-1])


class _Coasting(ArmPieces):
    """An arm whose joints do not accelerate."""

    @cached_property
    def turning(self) -> list[tuple[TaylorModel, TaylorModel]]:
        """Angular velocities, and accelerations of the joints' velocities alone."""
        _, qd, _ = self.pieces.joints
        return self._turning(qd, qd * 0.0)


def _combined(x: TaylorModel, y: TaylorModel, z: TaylorModel, by: Array) -> TaylorModel:
    """Returns x by[0] + y by[1] + z by[2] of vectors (3, n); what is multiplied by 0 is left out."""
    terms = [axis * float(share) for axis, share in zip((x, y, z), by, strict=True) if share != 0.0]
    if not terms:
        return x * 0.0
    found = terms[0]
    for term in terms[1:]:
        found = found + term
    return found
