"""The arms built in Pinocchio straight from the published URDF parameters: an independent route to compare with."""

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
PUBLISHED = Path(__file__).parent / "published"
SAME = {"ur7e": "ur5e", "ur12e": "ur10e"}  # published as links to these, but for their payloads
COMPLETE = {path.parent.name for path in PUBLISHED.glob("*/joint_limits.yaml")} | set(SAME)


class Loader(yaml.SafeLoader):
    """YAML with the `!degrees` tag of the published files."""


Loader.add_constructor("!degrees", lambda loader, node: np.radians(float(node.value)))


def published(name, document):
    """One published file: `default_kinematics`, `joint_limits` or `physical_parameters`."""
    return yaml.load(published_file(name, document).read_text(), Loader)


def published_file(name, document):
    """Where it is."""
    return PUBLISHED / SAME.get(name, name) / f"{document}.yaml"


def placement(origin, exact):
    """A URDF origin (x y z roll pitch yaw) as a Pinocchio pose; `exact` mends the quarter turns rounded to 1e-9."""
    angles = np.array([origin["roll"], origin["pitch"], origin["yaw"]], dtype=float)
    if exact:
        angles = np.round(angles / (np.pi / 2), 8) * (np.pi / 2)
    rotation = pin.rpy.rpyToMatrix(*angles)
    return pin.SE3(rotation, np.array([origin.get(k, 0.0) for k in "xyz"], dtype=float))


@cache
def pinocchio_arm(name, exact=False):
    """Pinocchio model of an arm from its URDF parameters.

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


def inertia(mass, link, exact):
    """Inertia of a link in its URDF frame."""
    com = np.array([mass["center_of_mass"][f"{link}_cog"][k] for k in "xyz"], dtype=float)
    t = mass["tensor"][link]
    tensor = np.array(
        [[t["ixx"], t["ixy"], t["ixz"]], [t["ixy"], t["iyy"], t["iyz"]], [t["ixz"], t["iyz"], t["izz"]]], dtype=float
    )
    R = placement(mass["rotation"][link], exact).rotation
    return pin.Inertia(mass[f"{link}_mass"], com, R @ tensor @ R.T)
