"""What the drawing asks about postures, answered by the judge's Pinocchio and coal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge import arm_model, object_in_flange, posture_room, singularity_distance
from planner.cell import Cell

Vector = NDArray[np.float64]

SPREAD_RAD = 1.3  # of postures about home
AROUND_S = (-0.05, 0.0, 0.05)  # [s] singularities count within 50 ms; source: docs/conventions.md
SPEED_SHARE = 0.7  # [-] of the joints' limits, at most
TOOL_SHARE = 0.9  # [-] of the tool's speed limit, at most
TRIES = 200  # of a state, before the problem is given up


class DrawnState(NamedTuple):
    """A joint state and what the tool does in it.

    Attributes:
        q, qd: joint positions and velocities (6,) [rad, rad/s].
        X_WT: pose of the tool in the world.
        v, w: its linear and angular velocity (3,) [m/s, rad/s].
    """

    q: Vector
    qd: Vector
    X_WT: pin.SE3
    v: Vector
    w: Vector


def state_of(cell: Cell, q: Vector, qd: Vector) -> DrawnState:
    """Returns a joint state with the tool's pose and twist."""
    model = arm_model(cell, False)
    data = model.createData()
    pin.forwardKinematics(model, data, q, qd)
    held = data.oMi[6] * pin.SE3(cell.tool.X_FT)
    flange = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    v = flange.linear + np.cross(flange.angular, held.translation - data.oMi[6].translation)
    return DrawnState(q, qd, held, v, flange.angular.copy())


def object_pose(cell: Cell, state: DrawnState) -> pin.SE3:
    """Returns the pose of the held object's axes in the world."""
    return state.X_WT * pin.SE3(cell.tool.X_FT).inverse() * pin.SE3(object_in_flange(cell))


def free_posture(cell: Cell, near: Vector, spread_rad: float, rng: np.random.Generator) -> Vector | None:
    """Returns joint positions near others in which the arm keeps every distance; None where none was drawn."""
    limits = cell.limits
    for _ in range(TRIES):
        q = np.clip(near + rng.uniform(-spread_rad, spread_rad, 6), limits.q_lower, limits.q_upper)
        if posture_room(cell, q) > 0.0:
            return q
    return None


def free_state(
    cell: Cell, near: Vector, rng: np.random.Generator, spread_rad: float = SPREAD_RAD, share: float = SPEED_SHARE
) -> DrawnState | None:
    """Returns a state that keeps distances, speeds and singularities by itself; None where none was drawn."""
    limits = cell.limits
    for _ in range(TRIES):
        q = free_posture(cell, near, spread_rad, rng)
        if q is None:
            return None
        qd = rng.uniform(-share, share, 6) * limits.qd_max
        speed = float(np.linalg.norm(state_of(cell, q, qd).v))
        qd = qd * min(1.0, TOOL_SHARE * limits.tcp_speed_max / max(speed, 1e-9))
        if min(singularity_distance(cell, q + s * qd) for s in AROUND_S) > limits.singularity_distance_min:
            return state_of(cell, q, qd)
    return None
