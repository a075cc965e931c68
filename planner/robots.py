"""The arms: published kinematics, limits, masses and shapes, read from `planner/robot_data/<name>.toml`.

Frames are the Denavit-Hartenberg frames of Universal Robots: frame 0 is the controller's "base", frame i moves with
link i, frame 6 is the flange.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from planner.errors import UnknownRobot

Array = NDArray[np.float64]

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
    """Mass of one link, in the DH frame that moves with it.

    `mass` [kg]; `com` (3,) centre of mass [m]; `inertia` (3, 3) about the centre of mass [kg m2].
    """

    name: str
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Shape:
    """Outer dimensions of an arm [m].

    The tube of the upper arm runs `shoulder_offset` beside joint 2 (along its axis), that of the forearm
    `elbow_offset`. Radii are of the foot, of the joints' housings (shoulder, elbow, wrist) and of the two tubes.
    """

    shoulder_offset: float
    elbow_offset: float
    base_radius: float
    shoulder_radius: float
    upper_arm_radius: float
    elbow_radius: float
    forearm_radius: float
    wrist_radius: float


@dataclass(frozen=True, eq=False)
class Robot:
    """One arm. Compared and hashed by identity: `robot(name)` gives the same object every time.

    `a`, `d` [m], `alpha` [rad]: DH parameters (6,). `q_lower`, `q_upper` [rad], `qd_max` [rad/s],
    `qdd_max` [rad/s2], `tau_max` [N m]: limits (6,).
    """

    name: str
    generation: Literal["CB3", "e-Series"]
    sample_rate_hz: int
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
    shape: Shape

    def __repr__(self) -> str:
        return f"Robot({self.name!r})"


@cache
def robot(name: str) -> Robot:
    """The arm of this name, one of `ROBOT_NAMES`.

    Raises:
        UnknownRobot: there is no such arm.
    """
    if name not in ROBOT_NAMES:
        raise UnknownRobot(name, ROBOT_NAMES)
    text = (files("planner") / "robot_data" / f"{name}.toml").read_text(encoding="utf-8")
    return _from_document(tomllib.loads(text))


def _from_document(document: Mapping[str, Any]) -> Robot:
    limits = document["limits"]
    return Robot(
        name=document["name"],
        generation=document["generation"],
        sample_rate_hz=document["sample_rate_hz"],
        joint_names=JOINT_NAMES,
        a=_fixed(document["dh"]["a_m"]),
        d=_fixed(document["dh"]["d_m"]),
        alpha=_fixed(DH_TWISTS),
        q_lower=_fixed(np.radians(limits["position_lower_deg"])),
        q_upper=_fixed(np.radians(limits["position_upper_deg"])),
        qd_max=_fixed(np.radians(limits["velocity_deg_s"])),
        qdd_max=_fixed(np.full(6, ACCELERATION_MAX)),
        tau_max=_fixed(limits["torque_n_m"]),
        links=tuple(_link(link) for link in document["links"]),
        shape=Shape(**{key.removesuffix("_m"): value for key, value in document["shape"].items()}),
    )


def _link(document: Mapping[str, Any]) -> Link:
    xx, xy, xz, yy, yz, zz = document["inertia_kg_m2"]
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return Link(document["name"], document["mass_kg"], _fixed(document["com_m"]), _fixed(inertia))


def _fixed(values: Sequence[Any] | Array) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
