"""Arm models: published kinematics, limits and masses, read from `planner/robot_data/<name>.toml`.

Of some arms not everything is published: they lack what `missing_numbers` says, and `completed` takes it from a cell
file. Nothing is made up for them. An arm that is `same_as` another has its numbers, but for those it states itself.

Frames are the Denavit-Hartenberg frames of Universal Robots: frame 0 is the controller's "base", frame i moves with
link i, frame 6 is the flange.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np

from planner.arrays import Array, read_only
from planner.errors import IncompleteRobot, UnknownRobot

# The arms whose kinematics, joint limits and masses are published, and those that lack some of these: a line each, and
# a file in `planner/robot_data`.
ROBOT_NAMES = (
    "ur3",
    "ur5",
    "ur10",
    "ur3e",
    "ur5e",
    "ur10e",
    "ur16e",
    "ur20",
    "ur30",
    "ur7e",
    "ur12e",
    "ur15",
    "ur18",
)
INCOMPLETE_NAMES = ("ur8long", "ur10g_1750", "ur17g_1300", "ur18g_950")

# Numbers that a cell file may give of an arm, by the table and key of the arm's own file; of links there is one a link.
ARM_NUMBERS = {
    "dh_a_m": ("dh", "a_m"),
    "dh_d_m": ("dh", "d_m"),
    "joint_position_lower_deg": ("limits", "position_lower_deg"),
    "joint_position_upper_deg": ("limits", "position_upper_deg"),
    "joint_velocity_deg_s": ("limits", "velocity_deg_s"),
    "joint_torque_n_m": ("limits", "torque_n_m"),
    "link_mass_kg": ("links", "mass_kg"),
    "link_com_m": ("links", "com_m"),
    "link_inertia_kg_m2": ("links", "inertia_kg_m2"),
    "payload_kg": ("", "payload_kg"),
}
LINK_NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
# What an arm can do without: certificates and warnings say that no payload is rated, and the joints of every arm with
# published limits turn as far as this, but for the last one of UR3 and UR3e, which has no end.
# source: ur_description, joint_limits.yaml of each
OPTIONAL = ("payload_kg", "joint_position_lower_deg", "joint_position_upper_deg")
TURN_DEG = [360.0, 360.0, 180.0, 360.0, 360.0, 360.0]
COMPLETED_KEPT = 64  # arms that are kept, so that equal ones are one object and share all caches

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


@dataclass(frozen=True)
class ShapeSource:
    """Where an arm's capsules are from.

    Attributes:
        of: the arm whose capsules were measured on meshes.
        tubes_m: of an arm whose meshes were not measured, z of the axes of upper arm and forearm in their frames [m]:
            its capsules are those of the other arm at its own lengths; None: they are the other arm's.
        foot_radius_m: of such an arm; None: that of the other.
    """

    of: str
    tubes_m: tuple[float, float] | None = None
    foot_radius_m: float | None = None

    @property
    def is_estimate(self) -> bool:
        """Whether the capsules are not known to contain the arm."""
        return self.tubes_m is not None


@dataclass(frozen=True, eq=False)
class Robot:
    """One arm model. Compared and hashed by identity: `robot(name)` returns the same object every time.

    Attributes:
        name: one of `ROBOT_NAMES` or `INCOMPLETE_NAMES`.
        generation: of the controller.
        sample_rate_hz: ticks per second.
        type_code: by which the controller's primary interface tells the model.
        payload_kg: rated mass of tool and object together [kg]; None: none is known.
        joint_names: from base to flange, as in ROS.
        a, d: DH lengths (6,) [m]; of a calibrated arm, distances between and along its axes.
        alpha: DH twists (6,) [rad], as published.
        q_lower, q_upper: limits on joint position (6,) [rad].
        qd_max: limits on joint velocity (6,) [rad/s].
        qdd_max: limits on joint acceleration (6,) [rad/s^2].
        tau_max: rated joint torques (6,) [N m].
        links: from base to flange.
        shape: where its capsules are from.
        fixed: transforms (6, 4, 4) between the joints' rotations, of an arm whose chain was measured; None for the
            published table. See `planner.calibration`.
        added: the numbers that `completed` was given, as JSON; empty where all of them are published.
    """

    name: str
    generation: Literal["CB3", "e-Series"]
    sample_rate_hz: int
    type_code: int
    payload_kg: float | None
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
    shape: ShapeSource
    fixed: Array | None = None
    added: str = ""

    def __repr__(self) -> str:
        return f"Robot({self.name!r})"

    @property
    def published(self) -> Robot:
        """The arm of the same model as it is published, or completed: its table and its limits."""
        return _completed(self.name, self.added) if self.added else robot(self.name)


@cache
def robot(name: str) -> Robot:
    """Returns the arm of this name, one of `ROBOT_NAMES`.

    Raises:
        UnknownRobot: there is no such arm.
        IncompleteRobot: it lacks numbers that are not published, and `completed` has to give.
    """
    document = _document(name)
    if missing := missing_numbers(name):
        raise IncompleteRobot(name, missing)
    return _from_document(document)


@cache
def capsule_rows(name: str) -> Mapping[str, Mapping[str, Any]]:
    """Returns the capsules around the links of an arm by their names, each with frame, ends and radius [m]."""
    text = (files("planner") / "robot_data" / "capsules.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)[name]


def missing_numbers(name: str) -> tuple[str, ...]:
    """Returns the keys of `ARM_NUMBERS` that an arm lacks and cannot do without.

    Raises:
        UnknownRobot: there is no such arm.
    """
    return tuple(key for key in ARM_NUMBERS if key not in OPTIONAL and published_number(name, key) is None)


def published_number(name: str, key: str) -> Any:
    """Returns a number of an arm by its key of `ARM_NUMBERS`, in the unit of that; None where it is not published.

    Raises:
        UnknownRobot: there is no such arm.
    """
    table, own = ARM_NUMBERS[key]
    document = _document(name)
    if table == "links":
        return [link[own] for link in document[table]] if table in document else None
    return (document.get(table, {}) if table else document).get(own)


def completed(name: str, numbers: Mapping[str, Any]) -> Robot:
    """Returns an arm with further numbers; the same object for the same numbers.

    Args:
        name: of the arm, one of `ROBOT_NAMES` or `INCOMPLETE_NAMES`.
        numbers: by the keys of `ARM_NUMBERS`, in units of the names; six entries each but for the payload.

    Raises:
        UnknownRobot: there is no such arm.
        IncompleteRobot: it still lacks numbers.
    """
    missing = tuple(key for key in missing_numbers(name) if key not in numbers)
    if missing:
        raise IncompleteRobot(name, missing)
    return _completed(name, json.dumps(numbers, sort_keys=True)) if numbers else robot(name)


@lru_cache(maxsize=COMPLETED_KEPT)
def _completed(name: str, numbers: str) -> Robot:
    document = {**_document(name)}
    for table in ("dh", "limits"):
        document[table] = {**document.get(table, {})}
    links = [{**link} for link in document.get("links", ({"name": link} for link in LINK_NAMES))]
    document["links"] = links
    for key, value in json.loads(numbers).items():
        table, own = ARM_NUMBERS[key]
        if table == "links":
            for link, entry in zip(links, value, strict=True):
                link[own] = entry
        else:
            (document[table] if table else document)[own] = value
    return _from_document(document, numbers)


@cache
def _document(name: str) -> dict[str, Any]:
    """Returns the document of an arm, not to be changed; of one that is the same as another, with the other's numbers.

    Raises:
        UnknownRobot: there is no such arm.
    """
    known = (*ROBOT_NAMES, *INCOMPLETE_NAMES)
    if name not in known:
        raise UnknownRobot(name, known)
    document = tomllib.loads((files("planner") / "robot_data" / f"{name}.toml").read_text(encoding="utf-8"))
    other = document.pop("same_as", None)
    if other is None:
        return {"capsules": {"like": name}, **document}
    return {**_document(other), **document}


def _from_document(document: Mapping[str, Any], added: str = "") -> Robot:
    limits = document["limits"]
    turn_deg = np.array(TURN_DEG)
    return Robot(
        name=document["name"],
        generation=document["generation"],
        sample_rate_hz=document["sample_rate_hz"],
        type_code=document["type_code"],
        payload_kg=document.get("payload_kg"),
        joint_names=JOINT_NAMES,
        a=read_only(document["dh"]["a_m"]),
        d=read_only(document["dh"]["d_m"]),
        alpha=read_only(DH_TWISTS),
        q_lower=read_only(np.radians(limits.get("position_lower_deg", -turn_deg))),
        q_upper=read_only(np.radians(limits.get("position_upper_deg", turn_deg))),
        qd_max=read_only(np.radians(limits["velocity_deg_s"])),
        qdd_max=read_only(np.full(6, ACCELERATION_MAX)),
        tau_max=read_only(limits["torque_n_m"]),
        links=tuple(_link(link) for link in document["links"]),
        shape=_shape_source(document["capsules"]),
        added=added,
    )


def _shape_source(document: Mapping[str, Any]) -> ShapeSource:
    if "upper_arm_z_m" not in document:
        return ShapeSource(document["like"])
    tubes_m = document["upper_arm_z_m"], document["forearm_z_m"]
    return ShapeSource(document["like"], tubes_m, document["foot_radius_m"])


def _link(document: Mapping[str, Any]) -> Link:
    xx, xy, xz, yy, yz, zz = document["inertia_kg_m2"]
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return Link(document["name"], document["mass_kg"], read_only(document["com_m"]), read_only(inertia))
