"""The arms built in Pinocchio from the published URDF parameters: another route than the planner's.

Of the arms whose kinematics or masses are not published, the numbers of the cell file and of the arm's own file stand
for them: the model is foreign then, the numbers are not.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from planner.robots import Robot

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
PUBLISHED = Path(__file__).parent / "published"
SAME = {"ur7e": "ur5e", "ur12e": "ur10e"}  # published as links to these, but for their payloads
COMPLETE = {path.parent.name for path in PUBLISHED.glob("*/joint_limits.yaml")} | set(SAME)
CHAINS = {path.parent.name for path in PUBLISHED.glob("*/default_kinematics.yaml")} | set(SAME)
# source: Universal Robots, "DH parameters for calculations of kinematics and dynamics": the same for every arm
TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


class Loader(yaml.SafeLoader):
    """YAML with the `!degrees` tag of the published files."""


Loader.add_constructor("!degrees", lambda loader, node: np.radians(float(node.value)))


def published(name: str, document: str) -> Any:
    """Returns one published file: `default_kinematics`, `joint_limits` or `physical_parameters`."""
    return yaml.load(published_file(name, document).read_text(encoding="utf-8"), Loader)


def published_file(name: str, document: str) -> Path:
    """Returns where it is."""
    return PUBLISHED / SAME.get(name, name) / f"{document}.yaml"


def placement(origin: Mapping[str, float], exact: bool) -> pin.SE3:
    """Returns a URDF origin (x y z roll pitch yaw) as a pose; `exact` mends the quarter turns rounded to 1e-9."""
    angles = np.array([origin["roll"], origin["pitch"], origin["yaw"]], dtype=float)
    if exact:
        angles = np.round(angles / (np.pi / 2), 8) * (np.pi / 2)
    rotation = pin.rpy.rpyToMatrix(*angles)
    return pin.SE3(rotation, np.array([origin.get(k, 0.0) for k in "xyz"], dtype=float))


@cache
def pinocchio_arm(name: str, exact: bool = False) -> pin.Model:
    """Returns the model of an arm from its URDF parameters.

    Its root is the controller's base (base_link turned by half a turn), its last joint's frame the flange.
    """
    origins = published(name, "default_kinematics")["kinematics"]
    mass = published(name, "physical_parameters")["inertia_parameters"]
    model = pin.Model()
    joint = 0
    for link in LINKS:
        joint = model.addJoint(joint, pin.JointModelRZ(), placement(origins[link], exact), link)
        model.appendBodyToJoint(joint, inertia(mass, link, exact), pin.SE3.Identity())
    return model


def inertia(mass: Mapping[str, Any], link: str, exact: bool) -> pin.Inertia:
    """Returns the inertia of a link in its URDF frame."""
    com = np.array([mass["center_of_mass"][f"{link}_cog"][k] for k in "xyz"], dtype=float)
    t = mass["tensor"][link]
    tensor = np.array(
        [[t["ixx"], t["ixy"], t["ixz"]], [t["ixy"], t["iyy"], t["iyz"]], [t["ixz"], t["iyz"], t["izz"]]], dtype=float
    )
    R = placement(mass["rotation"][link], exact).rotation
    return pin.Inertia(mass[f"{link}_mass"], com, R @ tensor @ R.T)


@cache
def robot_model(robot: Robot) -> pin.Model:
    """Returns the model of a cell's arm: the published one, or one of the numbers that the cell file adds.

    A chain that was measured is not audited: its joints are taken where they are published.
    """
    if robot.name in CHAINS and not robot.added:
        return pinocchio_arm(robot.name, exact=True)
    model = pin.Model()
    joint = 0
    before = pin.SE3.Identity()
    for i, link in enumerate(robot.links):
        # As in the URDF each joint's frame is along its own axis where the link's is: the last one is the flange.
        along = pin.SE3(np.eye(3), np.array([0.0, 0.0, robot.d[i]]))
        behind = along.inverse() * dh_placement(robot, i)
        joint = model.addJoint(joint, pin.JointModelRZ(), before * along, link.name)
        model.appendBodyToJoint(joint, pin.Inertia(link.mass, link.com, link.inertia), behind)
        before = behind
    return model


def dh_placement(robot: Robot, i: int) -> pin.SE3:
    """Returns the pose of link frame i + 1 behind the rotation of joint i, by the Denavit-Hartenberg table."""
    turn = pin.utils.rotate("x", TWISTS[i])
    return pin.SE3(turn, np.array([robot.a[i], 0.0, robot.d[i]]))
