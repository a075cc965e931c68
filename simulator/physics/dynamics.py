"""Joint torques of one arm on plain Python floats: a tenth of the cost of small numpy arrays, so no cycle is delayed.

The planner's dynamics is the reference; tests compare the two. Vectors are in the frame of their own link.
Source: Luh, Walker and Paul 1980, in the notation of Siciliano et al. 2009, section 7.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from planner.robots import Robot

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LinkBody:
    """Inertia and geometry of one link and the joint before it.

    Attributes:
        cosine, sine: of the angle alpha between this joint's axis and the next.
        offset: from the previous frame to this link's frame, in this link's frame [m].
        mass: [kg].
        com: centre of mass [m].
        inertia: about the centre of mass, rows of the matrix [kg m2].
    """

    cosine: float
    sine: float
    offset: Vector
    mass: float
    com: Vector
    inertia: tuple[Vector, ...]


@dataclass(frozen=True)
class LinkState:
    """Motion of a link, with cosine and sine of its joint angle."""

    c: float
    s: float
    spin: Vector
    spin_rate: Vector
    acceleration: Vector


class JointTorques:
    """Newton–Euler equations of an arm that carries a point mass."""

    def __init__(self, robot: Robot) -> None:
        self.bodies = []
        for a, d, alpha, link in zip(robot.a, robot.d, robot.alpha, robot.links, strict=True):
            c = math.cos(alpha)
            s = math.sin(alpha)
            inertia = tuple(tuple(row) for row in link.inertia.tolist())
            offset = (float(a), float(d) * s, float(d) * c)
            self.bodies.append(LinkBody(c, s, offset, float(link.mass), tuple(link.com.tolist()), inertia))

    def of(
        self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], upward: Vector, mass_kg: float, com: Vector
    ) -> list[float]:
        """Returns the joint torques (6,) [N m] of a motion.

        Args:
            q, qd, qdd: joint positions, velocities and accelerations (6,).
            upward: acceleration felt at rest, in the base [m/s2]; (0, 0, 9.81) for an arm on the floor.
            mass_kg: mass of the payload.
            com: its centre of mass in the flange's frame [m].
        """
        motions: list[LinkState] = []
        before = LinkState(1.0, 0.0, ZERO, ZERO, upward)
        for body, angle, v, a in zip(self.bodies, q, qd, qdd, strict=True):
            before = _moved(before, body, math.cos(angle), math.sin(angle), v, a)
            motions.append(before)
        force = _scaled(mass_kg, _acceleration(before, com))
        moment = _cross(com, force)
        torques = [0.0] * 6
        for k in reversed(range(6)):
            force, moment, torques[k] = _borne(self.bodies[k], motions[k], force, moment)
        return torques


def _moved(before: LinkState, body: LinkBody, c: float, s: float, v: float, a: float) -> LinkState:
    """Returns the motion of a link on a link moving as `before`; its joint turns at `v` [rad/s], `a` [rad/s2]."""
    wx, wy, wz = before.spin
    ux, uy, uz = before.spin_rate
    spin = _into((wx, wy, wz + v), body, c, s)
    rate = _into((ux + wy * v, uy - wx * v, uz + a), body, c, s)
    origin = LinkState(c, s, spin, rate, _into(before.acceleration, body, c, s))
    return LinkState(c, s, spin, rate, _acceleration(origin, body.offset))


def _borne(body: LinkBody, motion: LinkState, force: Vector, moment: Vector) -> tuple[Vector, Vector, float]:
    """Returns force, moment and torque at the joint of a link loaded with `force` and `moment` at its end."""
    own = _scaled(body.mass, _acceleration(motion, body.com))
    turning = _added(_times(body.inertia, motion.spin_rate), _cross(motion.spin, _times(body.inertia, motion.spin)))
    at_com = _added(_cross(body.com, own), turning)
    total = _added(force, own)
    about = _added(_added(moment, at_com), _cross(body.offset, total))
    before = _out_of(about, body, motion.c, motion.s)
    return _out_of(total, body, motion.c, motion.s), before, before[2]


def _acceleration(motion: LinkState, point: Vector) -> Vector:
    """Returns the acceleration of a point of a link."""
    turned = _cross(motion.spin, _cross(motion.spin, point))
    return _added(_added(motion.acceleration, _cross(motion.spin_rate, point)), turned)


def _into(v: Vector, body: LinkBody, c: float, s: float) -> Vector:
    """Returns a vector of the previous frame in the link's own frame."""
    x, y, z = v
    along = c * y - s * x
    return (c * x + s * y, body.cosine * along + body.sine * z, body.cosine * z - body.sine * along)


def _out_of(v: Vector, body: LinkBody, c: float, s: float) -> Vector:
    """Returns a vector of the link's own frame in the previous frame."""
    x, y, z = v
    along = body.cosine * y - body.sine * z
    return (c * x - s * along, s * x + c * along, body.sine * y + body.cosine * z)


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _added(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(k: float, a: Vector) -> Vector:
    return (k * a[0], k * a[1], k * a[2])


def _times(rows: tuple[Vector, ...], v: Vector) -> Vector:
    x, y, z = v
    a, b, c = rows
    return (a[0] * x + a[1] * y + a[2] * z, b[0] * x + b[1] * y + b[2] * z, c[0] * x + c[1] * y + c[2] * z)
