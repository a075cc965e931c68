"""Flight and landing of what a cell throws, audited: of a ball, or of a body by its turned shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from audit.judge.bodies import shadow_m2
from audit.judge.body_flights import body_flight_faults, body_landing_errors
from audit.judge.fault import AuditFault, over, under
from audit.judge.flights import (
    AIR_KG_M3,
    ANGLE_SLACK,
    ball_flight_faults,
    ball_landing_errors,
    integrate,
    release_state,
)
from planner.cell import Cell, ThrownBody
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

SPEED_SLACK_M_S = 2.2e-4  # [m/s] twice the certificate's tolerance, and rounding
PLACE_SLACK_M = 2e-5  # [m]


def flight_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns what is wrong with landing and flight of the releases in the window."""
    if not problem.throws:
        return []
    is_body = isinstance(problem.cell.object, ThrownBody)
    return body_flight_faults(problem, motion) if is_body else ball_flight_faults(problem, motion)


def landing_errors(problem: ThrowProblem, motion: Trajectory, delays: Vector) -> Vector:
    """Returns how far from its target the object lands (m,) [m] for delays of the release (m,) [s]; NaN: it does not.

    A ball lands where its centre comes down through the landing plane, a body where its turned shape first touches.
    """
    is_body = isinstance(problem.cell.object, ThrownBody)
    return (body_landing_errors if is_body else ball_landing_errors)(problem, motion, delays)


def aim_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns the bounds on the throw at a target that its release exceeds: speed, elevation, distance, place."""
    target = problem.release
    if not isinstance(target, TargetRelease):
        return []
    p, v = release_state(problem, motion)
    v = problem.cell.gripper.release_speed_factor * v
    speed = float(np.linalg.norm(v))
    elevation = float(np.arctan2(v[2], np.hypot(v[0], v[1])))
    found = []
    if np.isfinite(target.max_speed_m_s):
        found += over("release_velocity", "released at", speed, target.max_speed_m_s, SPEED_SLACK_M_S, "m/s")
    highest, lowest = target.max_elevation_rad, target.min_elevation_rad
    found += over("release_velocity", "released at an elevation of", elevation, highest, ANGLE_SLACK, "rad")
    found += under("release_velocity", "released at an elevation of", elevation, lowest, ANGLE_SLACK, "rad")
    if target.release_position is not None:
        off = float(np.linalg.norm(p - target.release_position))
        found += over("release_position", "another place of release", off, 0.0, PLACE_SLACK_M, "m")
    away = float(np.linalg.norm((target.p_W - p)[:2]))
    least = target.min_horizontal_distance_m
    return found + under("release_position", "horizontal distance to the target", away, least, PLACE_SLACK_M, "m")


def fall(cell: Cell, p: Vector, v: Vector, height: float) -> tuple[Vector, float] | None:
    """Returns where the centre of a cell's object falls through a height (3,) [m], and after how long [s].

    Args:
        cell: gives object and gravity.
        p, v: position and velocity of the tool centre point as it leaves (3,) [m, m/s].
        height: of the horizontal plane [m].
    """
    thing = cell.object
    area = shadow_m2(thing) if isinstance(thing, ThrownBody) else np.pi * thing.radius_m**2
    drag = AIR_KG_M3 * thing.drag_coefficient * area / (2.0 * thing.mass_kg)
    left = cell.gripper.release_speed_factor * v
    paths = integrate(p[None], left[None], height, 0.0, cell.surroundings.gravity_m_s2, drag)
    landed, seconds = paths.landed[0], float(paths.landed_s[0])
    return (landed, seconds) if np.isfinite(seconds) else None
