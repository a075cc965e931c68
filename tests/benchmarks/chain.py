"""The arms in Pinocchio, on their bases in the world, with tool and object: the second judge's own kinematics."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from planner.cell import Cell
from tests.planner.published_arms import pinocchio_arm

Vector = NDArray[np.float64]


@cache
def arm(cell: Cell, with_object: bool) -> pin.Model:
    """Returns the arm in Pinocchio on its base in the world, with tool and object as point masses on the flange."""
    model = pinocchio_arm(cell.robot.name, exact=True).copy()
    base = pin.SE3(cell.X_WB)
    model.jointPlacements[1] = base * model.jointPlacements[1]
    model.gravity.linear = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
    p_FT = cell.tool.X_FT[:3, 3]
    masses = [(cell.tool.mass_kg, 0.5 * p_FT)] + ([(cell.object.mass_kg, p_FT)] if with_object else [])
    for mass, place in masses:
        model.appendBodyToJoint(6, pin.Inertia(mass, place, np.zeros((3, 3))), pin.SE3.Identity())
    return model


def poses_of(cell: Cell, model: pin.Model, data: pin.Data, q: Vector, qd: Vector) -> tuple[list[pin.SE3], Vector]:
    """Returns the world poses of base and DH frames, and the tool centre's velocity (3,) [m/s]."""
    pin.forwardKinematics(model, data, q, qd)
    poses = [pin.SE3(cell.X_WB), *(data.oMi[i] * dh_in_urdf(cell.robot.name)[i - 1] for i in range(1, 7))]
    flange = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    arm_W = data.oMi[6].rotation @ cell.tool.X_FT[:3, 3]
    return poses, flange.linear + np.cross(flange.angular, arm_W)


@cache
def dh_in_urdf(name: str) -> list[pin.SE3]:
    """Returns the constant poses of the DH frames in the URDF's link frames, seen at the zero posture.

    The shapes are given in DH frames; both sets of frames move with the same links.
    """
    from planner.kinematics import link_poses
    from planner.robots import robot

    model = pinocchio_arm(name, exact=True)
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(6))
    return [data.oMi[i].inverse() * pin.SE3(link_poses(robot(name), np.zeros(6))[i]) for i in range(1, 7)]
