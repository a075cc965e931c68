"""The rows of a release in symbols: where the tool is, how fast, and where the object would land if it left now."""

from __future__ import annotations

from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import arm
from planner.backends.casadi_nlp.clearance import Held
from planner.backends.casadi_nlp.layout import ARM, RELEASE, Layout
from planner.backends.casadi_nlp.stages import Rows, state

SX = Any

GUARD = 0.01  # [m^2/s^2] bends the discriminant of a flight that never reaches the plane to above zero
TINY = 1e-9  # [m^2/s^2] keeps the horizontal speed away from zero

ROWS = Layout(
    {
        "position": 3,  # of the tool centre in the world [m]
        "velocity": 3,  # [m/s]
        "landing": 2,  # horizontal miss of the target [m]
        "drift": 2,  # how fast the miss changes with a later release [m/s]
        "falls": 1,  # discriminant of the flight time [m^2/s^2]: above zero where the object reaches the plane
        "elevation": 2,  # vertical speed less tan(elevation) times the horizontal [m/s]: of the least, of the largest
        "speed": 1,  # squared [m^2/s^2]
        "distance": 1,  # squared horizontal distance to the target [m^2]
    }
)


def release(z: SX, p: SX) -> Rows:
    """The rows of `ROWS` at the stage's beginning; p: `ARM`, then `RELEASE`."""
    s, a, r = state(z), ARM.split(p[: ARM.size]), RELEASE.split(p[ARM.size :])
    R_WB, p_WB = ca.reshape(a["base"][:9], 3, 3), a["base"][9:]
    R_WS = R_WB @ arm.turn(s.q[0])
    tool = arm.tool_motion(a["dh"], a["tcp"], s.q, s.qd, s.qdd)
    position, velocity, acceleration = R_WS @ tool.position + p_WB, R_WS @ tool.velocity, R_WS @ tool.acceleration
    landing, falls = _landing(position, velocity, r)
    drift = _drift(velocity, acceleration, position, r)
    level = ca.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + TINY)
    away = position[:2] - r["target"][:2]
    rows = ca.vertcat(
        position,
        velocity,
        landing - r["target"][:2],
        drift,
        falls,
        velocity[2] - r["tan_elevation"] * level,
        ca.sumsqr(velocity),
        ca.sumsqr(away),
    )
    return Rows(rows, Held())


def _landing(position: SX, velocity: SX, r: dict[str, SX]) -> tuple[SX, SX]:
    """Returns the drag-free landing point (2,) on the target's plane [m], and the discriminant [m^2/s^2]."""
    g = r["gravity_z"]
    falls = velocity[2] ** 2 + 2 * g * (position[2] - r["target"][2])
    guarded = (falls + ca.sqrt(falls**2 + GUARD**2)) / 2
    # Where the object clearly falls, the guard is far below what it protects: GUARD^2 / (4 falls).
    time = (velocity[2] + ca.sqrt(guarded)) / g
    return position[:2] + velocity[:2] * time, falls


def _drift(velocity: SX, acceleration: SX, position: SX, r: dict[str, SX]) -> SX:
    p, v = ca.SX.sym("p", 3), ca.SX.sym("v", 3)
    point, _ = _landing(p, v, r)
    rate = ca.jtimes(point, p, velocity) + ca.jtimes(point, v, acceleration)
    return ca.substitute([rate], [p, v], [position, velocity])[0]
