"""Pinocchio models of the arms on their bases, with tool and object: the kinematics of the audit."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge.published_arms import dh_placement, robot_model
from planner.cell import Cell, ThrownBody
from planner.robots import Robot

Vector = NDArray[np.float64]

CELLS_KEPT = 16  # in a process: of 10,000 cells the models would fill the memory


@lru_cache(maxsize=2 * CELLS_KEPT)
def arm_model(cell: Cell, with_object: bool) -> pin.Model:
    """Returns the Pinocchio model of a cell's arm, with tool and (optionally) object on the flange.

    The tool and a ball as point masses, an object that is no ball with its inertia. What other grippers hold is on it.
    """
    model = robot_model(cell.robot).copy()
    base = pin.SE3(cell.X_WB)
    model.jointPlacements[1] = base * model.jointPlacements[1]
    model.gravity.linear = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
    half_way = 0.5 * cell.tool.end_F
    model.appendBodyToJoint(6, pin.Inertia(cell.tool.mass_kg, half_way, np.zeros((3, 3))), pin.SE3.Identity())
    for each in cell.carried:
        model.appendBodyToJoint(6, pin.Inertia(each.mass_kg, each.p_F, np.zeros((3, 3))), pin.SE3.Identity())
    if with_object:
        thing = cell.object
        moments = np.diag(thing.inertia_kg_m2) if isinstance(thing, ThrownBody) else np.zeros((3, 3))
        lies = pin.SE3(object_in_flange(cell))
        model.appendBodyToJoint(6, lies.act(pin.Inertia(thing.mass_kg, np.zeros(3), moments)), pin.SE3.Identity())
    return model


def object_in_flange(cell: Cell) -> Vector:
    """Returns the pose (4, 4) of the held object's axes in the flange frame."""
    X_FO = cell.tool.X_FT.copy()
    if isinstance(cell.object, ThrownBody):
        X_FO[:3, :3] = X_FO[:3, :3] @ cell.object.R_TO
    return X_FO


def poses_and_velocity(
    cell: Cell, model: pin.Model, data: pin.Data, q: Vector, qd: Vector
) -> tuple[list[pin.SE3], Vector]:
    """Returns the poses of base and DH frames, and the velocity (3,) of the tool centre point [m/s], in the world.

    Args:
        cell: The cell.
        model: Its arm, from `arm_model`.
        data: Pinocchio's workspace of the model.
        q: Joint positions (6,) [rad].
        qd: Joint velocities (6,) [rad/s].
    """
    pin.forwardKinematics(model, data, q, qd)
    poses = [pin.SE3(cell.X_WB), *(data.oMi[i] * dh_frames_in_urdf(cell.robot)[i - 1] for i in range(1, 7))]
    flange = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    arm_W = data.oMi[6].rotation @ cell.tool.X_FT[:3, 3]
    return poses, flange.linear + pin.skew(flange.angular) @ arm_W


@cache
def dh_frames_in_urdf(robot: Robot) -> list[pin.SE3]:
    """Returns the constant poses of the DH frames in the joints' frames of Pinocchio, derived at the zero posture.

    The arms' shapes are defined in DH frames; both sets of frames move with the same links.
    """
    model = robot_model(robot)
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(6))
    found = []
    at = pin.SE3.Identity()
    for i in range(6):
        at = at * dh_placement(robot, i)
        found.append(data.oMi[i + 1].inverse() * at)
    return found
