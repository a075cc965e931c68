"""Arm models: published kinematics, limits and masses, read from `planner/robot_data/<name>.toml`.

Frames are the Denavit-Hartenberg frames of Universal Robots: frame 0 is the controller's "base", frame i moves with
link i, frame 6 is the flange.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np

from planner.arrays import Array, read_only
from planner.errors import UnknownRobot

ROBOT_NAMES = ("ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e", "ur20", "ur30")

# source: ROS driver of Universal Robots, ur_description, joint names of `ur_macro.xacro`
JOINT_NAMES = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)

# source: Universal Robots, "DH parameters for calculations of kinematics and dynamics": the same for every arm
DH_TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)

# source: ur_rtde 1.6.5, argument check of speedJ: an acceleration in [0, 40] rad/s2; the arms publish none
ACCELERATION_MAX = 40.0


@dataclass(frozen=True, eq=False)
class Link:
    """One rigid body of the arm, in the DH frame that moves with it.

    Attributes:
        name: of the link.
        mass: [kg].
        com: centre of mass (3,) [m].
        inertia: about the centre of mass (3, 3) [kg m^2].
    """

    name: str
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """One arm model. Compared and hashed by identity: `robot(name)` returns the same object every time.

    Attributes:
        name: one of `ROBOT_NAMES`.
        generation: of the controller.
        sample_rate_hz: ticks per second.
        payload_kg: rated mass of tool and object together [kg].
        joint_names: from base to flange, as in ROS.
        a, d: DH lengths (6,) [m]; of a calibrated arm, distances between and along its axes.
        alpha: DH twists (6,) [rad], as published.
        q_lower, q_upper: limits on joint position (6,) [rad].
        qd_max: limits on joint velocity (6,) [rad/s].
        qdd_max: limits on joint acceleration (6,) [rad/s^2].
        tau_max: rated joint torques (6,) [N m].
        links: from base to flange.
        fixed: transforms (6, 4, 4) between the joints' rotations, of an arm whose chain was measured; None for the
            published table. See `planner.calibration`.
    """

    name: str
    generation: Literal["CB3", "e-Series"]
    sample_rate_hz: int
    payload_kg: float
    joint_names: tuple[str, ...]
    a: Array
    d: Array
    alpha: Array
    q_lower: Array
    q_upper: Array
    qd_max: Array
    qdd_max: Array
    tau_max: Array
    links: tuple[Link, ...]
    fixed: Array | None = None

    def __repr__(self) -> str:
        return f"Robot({self.name!r})"

    @property
    def published(self) -> Robot:
        """The arm of the same model as it is published: its table and its limits."""
        return robot(self.name)


@cache
def robot(name: str) -> Robot:
    """Returns the arm of this name, one of `ROBOT_NAMES`.

    Raises:
        UnknownRobot: there is no such arm.
    """
    if name not in ROBOT_NAMES:
        raise UnknownRobot(name, ROBOT_NAMES)
    text = (files("planner") / "robot_data" / f"{name}.toml").read_text(encoding="utf-8")
    return _from_document(tomllib.loads(text))


@cache
def capsule_rows(name: str) -> Mapping[str, Mapping[str, Any]]:
    """Returns the capsules around the links of an arm by their names, each with frame, ends and radius [m]."""
    text = (files("planner") / "robot_data" / "capsules.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)[name]


def _from_document(document: Mapping[str, Any]) -> Robot:
    limits = document["limits"]
    return Robot(
        name=document["name"],
        generation=document["generation"],
        sample_rate_hz=document["sample_rate_hz"],
        payload_kg=document["payload_kg"],
        joint_names=JOINT_NAMES,
        a=read_only(document["dh"]["a_m"]),
        d=read_only(document["dh"]["d_m"]),
        alpha=read_only(DH_TWISTS),
        q_lower=read_only(np.radians(limits["position_lower_deg"])),
        q_upper=read_only(np.radians(limits["position_upper_deg"])),
        qd_max=read_only(np.radians(limits["velocity_deg_s"])),
        qdd_max=read_only(np.full(6, ACCELERATION_MAX)),
        tau_max=read_only(limits["torque_n_m"]),
        links=tuple(_link(link) for link in document["links"]),
    )


def _link(document: Mapping[str, Any]) -> Link:
    xx, xy, xz, yy, yz, zz = document["inertia_kg_m2"]
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return Link(document["name"], document["mass_kg"], read_only(document["com_m"]), read_only(inertia))
