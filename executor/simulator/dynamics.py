"""Joint torques of one arm on plain Python floats: a tenth of what small numpy arrays cost, so no cycle is delayed.

The planner's dynamics is the reference; tests hold the two together. Vectors are in the frame of their own link.
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
class Body:
    """One link and the joint before it.

    Attributes:
        cosine, sine: of the angle alpha between this joint's axis and the next.
        arm: from the frame before to this link's frame, in this link's [m].
        mass: [kg].
        com: centre of mass [m].
        inertia: about it, the rows of the matrix [kg m2].
    """

    cosine: float
    sine: float
    arm: Vector
    mass: float
    com: Vector
    inertia: tuple[Vector, ...]


@dataclass(frozen=True)
class Motion:
    """How a link moves, and what turned it there: cosine and sine of its joint."""

    c: float
    s: float
    spin: Vector
    spin_rate: Vector
    acceleration: Vector


class Torques:
    """Newton and Euler's equations of an arm that carries a point mass."""

    def __init__(self, arm: Robot) -> None:
        self.bodies = []
        for a, d, alpha, link in zip(arm.a, arm.d, arm.alpha, arm.links, strict=True):
            c, s = math.cos(alpha), math.sin(alpha)
            inertia = tuple(tuple(row) for row in link.inertia.tolist())
            reach = (float(a), float(d) * s, float(d) * c)
            self.bodies.append(Body(c, s, reach, float(link.mass), tuple(link.com.tolist()), inertia))

    def of(
        self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], upward: Vector, mass_kg: float, com: Vector
    ) -> list[float]:
        """Returns the torques (6,) [N m] of a motion; `mass_kg` sits at `com` [m] in the flange's frame.

        `upward` is what an arm at rest feels [m/s2]: (0, 0, 9.81) for one on the floor.
        """
        motions: list[Motion] = []
        before = Motion(1.0, 0.0, ZERO, ZERO, upward)
        for body, angle, v, a in zip(self.bodies, q, qd, qdd, strict=True):
            before = _moved(before, body, math.cos(angle), math.sin(angle), v, a)
            motions.append(before)
        force = _scaled(mass_kg, _acceleration(before, com))
        moment = _cross(com, force)
        torques = [0.0] * 6
        for k in reversed(range(6)):
            force, moment, torques[k] = _borne(self.bodies[k], motions[k], force, moment)
        return torques


def _moved(before: Motion, body: Body, c: float, s: float, v: float, a: float) -> Motion:
    """Returns how a link moves whose joint turns at `v` [rad/s], `a` [rad/s2] on a link that moves as `before`."""
    wx, wy, wz = before.spin
    ux, uy, uz = before.spin_rate
    spin = _into((wx, wy, wz + v), body, c, s)
    rate = _into((ux + wy * v, uy - wx * v, uz + a), body, c, s)
    origin = Motion(c, s, spin, rate, _into(before.acceleration, body, c, s))
    return Motion(c, s, spin, rate, _acceleration(origin, body.arm))


def _borne(body: Body, motion: Motion, force: Vector, moment: Vector) -> tuple[Vector, Vector, float]:
    """Returns force, moment and torque at the joint of a link, whose end bears `force` and `moment`."""
    own = _scaled(body.mass, _acceleration(motion, body.com))
    turning = _added(_times(body.inertia, motion.spin_rate), _cross(motion.spin, _times(body.inertia, motion.spin)))
    at_com = _added(_cross(body.com, own), turning)
    total = _added(force, own)
    about = _added(_added(moment, at_com), _cross(body.arm, total))
    before = _out_of(about, body, motion.c, motion.s)
    return _out_of(total, body, motion.c, motion.s), before, before[2]


def _acceleration(motion: Motion, point: Vector) -> Vector:
    """Returns the acceleration of a point of a link."""
    turned = _cross(motion.spin, _cross(motion.spin, point))
    return _added(_added(motion.acceleration, _cross(motion.spin_rate, point)), turned)


def _into(v: Vector, body: Body, c: float, s: float) -> Vector:
    """Returns a vector of the frame before in the link's own."""
    x, y, z = v
    along = c * y - s * x
    return (c * x + s * y, body.cosine * along + body.sine * z, body.cosine * z - body.sine * along)


def _out_of(v: Vector, body: Body, c: float, s: float) -> Vector:
    """Returns a vector of the link's own frame in the one before."""
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
