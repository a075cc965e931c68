"""Symbolic arm formulas: kinematics of the UR family in closed form, and joint torques.

All arms share one geometry: axes 2, 3 and 4 are parallel, so their angles add, and only six lengths differ. The
first joint turns everything about the base's z axis. Quantities that do not depend on that turn are written in a frame
S that turns with it, which takes q1 out of the formulas and of their derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

SX = Any  # casadi's type stubs are incomplete

# Fixed rotations about x by alpha_i. source: UR, "DH parameters for calculations of kinematics and dynamics"
ALPHA_QUARTERS = (1, 0, 0, 1, -1, 0)  # alpha_i / (pi / 2)


@dataclass(frozen=True)
class ArmFrames:
    """Rotations (3, 3) and origins (3,) in S of DH frames 0 to 6."""

    rotations: tuple[SX, ...]
    origins: tuple[SX, ...]

    def point(self, frame: int, local: SX) -> SX:
        """Returns the point `local` (3,) of a frame in S."""
        return self.origins[frame] + self.rotations[frame] @ local


def frames(dh: SX, q: SX) -> ArmFrames:
    """Returns the frames in S for the lengths d1, a2, a3, d4, d5, d6 [m] and joint positions (6,) [rad].

    Frame 0 is the base, turned by -q1 in S.
    """
    x1 = ca.SX([1, 0, 0])
    y1 = ca.SX([0, 0, 1])
    z1 = ca.SX([0, -1, 0])
    a2 = q[1]
    a3 = q[1] + q[2]
    a4 = a3 + q[3]
    along = [ca.cos(a) * x1 + ca.sin(a) * y1 for a in (a2, a3, a4)]
    across = [-ca.sin(a) * x1 + ca.cos(a) * y1 for a in (a2, a3, a4)]
    z4 = -across[2]
    x5 = ca.cos(q[4]) * along[2] + ca.sin(q[4]) * z1
    z5 = -ca.sin(q[4]) * along[2] + ca.cos(q[4]) * z1
    x6 = ca.cos(q[5]) * x5 - ca.sin(q[5]) * z4
    y6 = -ca.sin(q[5]) * x5 - ca.cos(q[5]) * z4
    o1 = ca.vertcat(0, 0, dh[0])
    o2 = o1 + dh[1] * along[0]
    o3 = o2 + dh[2] * along[1]
    o4 = o3 + dh[3] * z1
    o5 = o4 + dh[4] * z4
    rotations = (
        turn(-q[0]),
        ca.horzcat(x1, y1, z1),
        ca.horzcat(along[0], across[0], z1),
        ca.horzcat(along[1], across[1], z1),
        ca.horzcat(along[2], z1, z4),
        ca.horzcat(x5, -z4, z5),
        ca.horzcat(x6, y6, z5),
    )
    return ArmFrames(rotations, (ca.SX.zeros(3), o1, o2, o3, o4, o5, o5 + dh[5] * z5))


def turn(angle: SX) -> SX:
    """Returns the rotation (3, 3) about z."""
    c = ca.cos(angle)
    s = ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))


def world_axes(base: SX, q: SX) -> SX:
    """Returns S's axes in the world (3, 3) for the base's pose (12,), see `layout.ARM`, and joint positions (6,)."""
    return ca.reshape(base[:9], 3, 3) @ turn(q[0])


@dataclass(frozen=True)
class ToolMotion:
    """Position [m], velocity [m/s] and acceleration [m/s^2] of the tool centre point, each (3,) along S's axes."""

    position: SX
    velocity: SX
    acceleration: SX


def tool_motion(dh: SX, tcp: SX, q: SX, qd: SX, qdd: SX) -> ToolMotion:
    """Returns the motion of the tool centre point, at `tcp` (3,) [m] in the flange."""
    at, speed, change = (ca.SX.sym(name, 6) for name in ("q", "qd", "qdd"))
    p = frames(dh, at).point(6, tcp)
    v = ca.jtimes(p, at, speed) + speed[0] * ca.vertcat(-p[1], p[0], 0)
    a = ca.jtimes(v, at, speed) + ca.jtimes(v, speed, change) + speed[0] * ca.vertcat(-v[1], v[0], 0)
    return ToolMotion(*ca.substitute([p, v, a], [at, speed, change], [q, qd, qdd]))


def shoulder_distance(dh: SX, q: SX) -> SX:
    """Returns the wrist centre's signed distance from joint 1's axis, divided by the arm's length |a2| + |a3| [-].

    Zero at the shoulder singularity. source: factor of the Jacobian's determinant, as in planner.kinematics.
    """
    a3 = q[1] + q[2]
    reach = dh[1] * ca.cos(q[1]) + dh[2] * ca.cos(a3) + dh[4] * ca.sin(a3 + q[3])
    return reach / (ca.fabs(dh[1]) + ca.fabs(dh[2]))


def torques(dh: SX, links: SX, gravity: SX, q: SX, qd: SX, qdd: SX) -> SX:
    """Returns the joint torques (6,) [N m] by the Newton-Euler recursion in the links' own frames.

    Args:
        dh: d1, a2, a3, d4, d5, d6 [m].
        links: per link mass [kg], first moment (3) [kg m], inertia about the frame's origin (6) [kg m^2].
        gravity: upward acceleration of the base equivalent to gravity (3,) [m/s^2].
        q: joint positions (6,) [rad].
        qd: velocities (6,) [rad/s].
        qdd: accelerations (6,) [rad/s^2].
    """
    shifts = _shifts(dh)
    spin = ca.SX(3, 1)
    acc = ca.SX(3, 1)
    lift = gravity
    rotations = []
    wrenches = []
    for i in range(6):
        R = turn(q[i]) @ _tilt(ALPHA_QUARTERS[i])
        up = ca.SX([0, 0, 1])
        acc = R.T @ (acc + qdd[i] * up + ca.cross(spin, qd[i] * up))
        spin = R.T @ (spin + qd[i] * up)
        lift = R.T @ lift + ca.cross(acc, shifts[i]) + ca.cross(spin, ca.cross(spin, shifts[i]))
        rotations.append(R)
        wrenches.append(_wrench(links[10 * i : 10 * i + 10], spin, acc, lift))
    return _propagate(rotations, shifts, wrenches)


def _shifts(dh: SX) -> list[SX]:
    """Returns each frame's origin relative to the previous one's, in itself: (a, d sin alpha, d cos alpha)."""
    lengths = ((0, dh[0]), (dh[1], 0), (dh[2], 0), (0, dh[3]), (0, dh[4]), (0, dh[5]))
    return [ca.vertcat(a, d * (k % 2) * k, d * (1 - k % 2)) for (a, d), k in zip(lengths, ALPHA_QUARTERS, strict=True)]


def _tilt(quarters: int) -> SX:
    """Returns the rotation about x by -1, 0 or 1 quarter turns."""
    c, s = (1, 0) if quarters == 0 else (0, quarters)
    return ca.sparsify(ca.SX([[1, 0, 0], [0, c, -s], [0, s, c]]))


def _wrench(link: SX, spin: SX, acc: SX, lift: SX) -> tuple[SX, SX]:
    """Returns the force and the moment about the frame's origin that move one link."""
    mass = link[0]
    moment = link[1:4]
    i = link[4:]
    inertia = ca.vertcat(ca.horzcat(i[0], i[1], i[2]), ca.horzcat(i[1], i[3], i[4]), ca.horzcat(i[2], i[4], i[5]))
    force = mass * lift + ca.cross(acc, moment) + ca.cross(spin, ca.cross(spin, moment))
    return force, inertia @ acc + ca.cross(spin, inertia @ spin) + ca.cross(moment, lift)


def _propagate(rotations: list[SX], shifts: list[SX], wrenches: list[tuple[SX, SX]]) -> SX:
    force = ca.SX(3, 1)
    moment = ca.SX(3, 1)
    tau = []
    for R, shift, (f, m) in reversed(list(zip(rotations, shifts, wrenches, strict=True))):
        force = force + f
        moment = moment + m  # at this frame's origin
        moment = R @ (moment + ca.cross(shift, force))  # at the joint, in the previous frame
        force = R @ force
        tau.append(moment[2])
    return ca.vertcat(*reversed(tau))
