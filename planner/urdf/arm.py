"""The arm in a URDF file: its six joints, its model, and its chain, limits and masses in Fling's frames.

A description may place its frames anywhere on the joints' axes, name its links as it likes, and stand on a robot or a
table. What counts is how the axes lie while every joint is at 0: z up, the arm stretched along -x, its second to fourth
axis parallel. Fling's frames are put on these axes as on those of a measured arm, see `planner.calibration`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.calibration import DhTable, ImplausibleChain, calibrated, transforms_of_links, transforms_of_table
from planner.errors import IncompleteRobot, UnknownRobot
from planner.fields import did_you_mean
from planner.kinematics import chain_difference
from planner.robots import (
    DH_TWISTS,
    INCOMPLETE_NAMES,
    JOINT_NAMES,
    ROBOT_NAMES,
    Robot,
    completed,
    published_number,
    robot,
)
from planner.rotations import invert_pose, pose
from planner.urdf.tree import MOVING, UrdfJoint, UrdfRefused, UrdfTree

FLANGE = "tool0"  # link of UR's descriptions that is the controller's flange, whatever stands before its name
SAME_M = 1e-8  # [m] a chain this close to the published one is that: descriptions round quarter turns to nine digits
SAME_MASS = 1e-6  # [kg, m, kg m^2] rounding of masses in a file
ALIKE_M = 1e-9  # [m] two models this much alike have the same kinematics, as UR5e and UR7e
LIKE_M = 0.05  # [m] by which the lengths of a measured arm may differ from those of its model, before one looks closer
TURNED = 0.05  # [-] sine of the angle by which axes may be turned against the layout of Universal Robots

# How the axes of joints 2 to 6 lie at position 0: the number of another axis, from 0, and how they are to it.
# source: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
AXES = ((0, "across"), (1, "parallel to"), (2, "parallel to"), (3, "across"), (4, "across"))


@dataclass(frozen=True, eq=False)
class DescribedArm:
    """The arm in a URDF file.

    Attributes:
        robot: with the file's chain, where that is not the published one.
        numbers: of the arm that the file adds to what is published, by the keys of `ARM_NUMBERS`.
        joints: of the file, from base to flange.
        X_RB: pose of the arm's base in the file's root (4, 4).
        X_RF: pose of the flange in the root (4, 4), with every joint at position 0.
        notes: what a person should know, in sentences.
    """

    robot: Robot
    numbers: Mapping[str, Any]
    joints: Sequence[UrdfJoint]
    X_RB: Array
    X_RF: Array
    notes: Sequence[str]


def arm_in(tree: UrdfTree, model: str | None = None) -> DescribedArm:
    """Returns the arm in a URDF file.

    Args:
        tree: of the file.
        model: name of the arm's model; None: the closest of those whose kinematics are published.

    Raises:
        UrdfRefused: it has no six joints in a row, its axes do not lie as those of an arm of Universal Robots, or it
            lacks what is not published of the model.
    """
    joints = six_joints(tree)
    X_RB, frames = joint_frames(tree, joints)
    X_RF = tree.pose(_flange_link(tree, joints[5].child))
    X_BF = invert_pose(X_RB) @ X_RF
    lengths = _lengths(joints, frames, X_BF)
    name, notes = _model(tree, lengths) if model is None else (model, [])
    links = [frames[0], *(invert_pose(frames[i]) @ frames[i + 1] for i in range(5))]
    transforms = transforms_of_links(links, invert_pose(frames[5]) @ X_BF)
    try:
        a, d = (published_number(name, key) or lengths[key] for key in ("dh_a_m", "dh_d_m"))
    except UnknownRobot as error:
        raise UrdfRefused(f"{error}{did_you_mean(name, error.known)}") from error
    published = transforms_of_table(DhTable(read_only(np.zeros(6)), read_only(a), read_only(d), read_only(DH_TWISTS)))
    masses = _masses(tree, joints, X_RB, published)
    arm, numbers = _with_numbers(name, {**lengths, **_limits(joints), **masses}, tree, joints)
    try:
        measured = calibrated(arm, transforms)
    except ImplausibleChain as error:
        raise UrdfRefused(f"its arm is no {name}: {error}") from error
    assert measured.fixed is not None
    notes += _notes_on_masses(name, masses, numbers)
    apart = chain_difference(arm, measured)
    if apart.largest_m <= SAME_M:
        return DescribedArm(arm, numbers, joints, X_RB, X_RF, notes)
    if "link_mass_kg" in numbers:  # in the frames of the measured chain, on which they will stand
        numbers |= _masses(tree, joints, X_RB, measured.fixed)
        measured = calibrated(completed(name, numbers), transforms)
    notes.append(f"its chain is {apart.words(2)} off the published one, and is written as a calibration file")
    return DescribedArm(measured, numbers, joints, X_RB, X_RF, notes)


def six_joints(tree: UrdfTree) -> list[UrdfJoint]:
    """Returns the joints of the arm, from base to flange: those with UR's names, or else all that move.

    Raises:
        UrdfRefused: there are not six in a row, or one of them does not turn.
    """
    moving = [joint for joint in tree.joints.values() if joint.moves]
    prefixes = [j.name.removesuffix(JOINT_NAMES[0]) for j in moving if j.name.endswith(JOINT_NAMES[0])]
    by_name = {joint.name: joint for joint in moving}
    whole = [prefix for prefix in prefixes if all(prefix + name in by_name for name in JOINT_NAMES)]
    if len(whole) > 1:
        raise UrdfRefused(f"has {len(whole)} arms ({', '.join(whole)}): a cell has one")
    found = [by_name[whole[0] + name] for name in JOINT_NAMES] if whole else moving
    if len(found) != 6:
        listed = ", ".join(joint.name for joint in found[:8]) or "none"
        reason = f"an arm of Universal Robots has 6, named {JOINT_NAMES[0]} and so on where others move too"
        raise UrdfRefused(f"has {len(found)} moving joints ({listed}); {reason}")
    found.sort(key=lambda joint: len(tree.above(joint.child)))
    for joint, following in pairwise(found):
        if joint not in tree.above(following.parent):
            raise UrdfRefused(f"joint {following.name} does not follow {joint.name}: the six joints are in a row")
    for joint in found:
        if joint.kind not in MOVING:
            raise UrdfRefused(f"joint {joint.name} is {joint.kind}: every joint of the arm turns")
        others = [other.name for other in tree.above(joint.parent) if other.moves and other not in found]
        if others:
            raise UrdfRefused(f"joint {others[0]} moves the arm's base, or is between its joints: it has to be fixed")
    return found


def joint_frames(tree: UrdfTree, joints: Sequence[UrdfJoint]) -> tuple[Array, list[Array]]:
    """Returns the base in the root (4, 4), and the joints' frames in the base: z along the axis, at position 0."""
    X = [tree.pose(joint.child) @ _turned_to(joint.axis) for joint in joints]
    foot = tree.pose(joints[0].parent)
    up = X[0][:3, 2]
    # On the first axis, beside the link that carries the arm, and turned like it where that stands upright.
    p = X[0][:3, 3] + up * (up @ (foot[:3, 3] - X[0][:3, 3]))
    ahead = foot[:3, 0] - up * (up @ foot[:3, 0])
    if np.linalg.norm(ahead) < TURNED:
        ahead = X[0][:3, 0]
    ahead = ahead / np.linalg.norm(ahead)
    X_RB = pose(p, np.column_stack([ahead, np.cross(up, ahead), up]))
    return X_RB, [invert_pose(X_RB) @ frame for frame in X]


def _turned_to(axis: Array) -> Array:
    """Returns a rotation (4, 4) whose z is the axis; none where it is z already."""
    X = np.eye(4)
    if abs(axis[2]) > 1.0 - 1e-12 and axis[2] > 0.0:
        return X
    x = np.cross([0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [0.0, 0.0, 1.0], axis)
    x = x / np.linalg.norm(x)
    X[:3, :3] = np.column_stack([x, np.cross(axis, x), axis])
    return X


def _flange_link(tree: UrdfTree, last: str) -> str:
    """Returns the link that is the flange: `tool0` where there is one beside the last link, or else the last link."""
    found = [link for link in tree.below(last) if link.endswith(FLANGE)]
    return found[0] if found else last


def _lengths(joints: Sequence[UrdfJoint], frames: Sequence[Array], flange: Array) -> dict[str, list[float]]:
    """Returns the lengths that the axes' places give.

    Raises:
        UrdfRefused: the axes are not turned against one another like those of Universal Robots.
    """
    z = [frame[:3, 2] for frame in frames]
    p = [frame[:3, 3] for frame in frames]
    for i, (j, words) in enumerate(AXES, start=1):
        across = float(np.linalg.norm(np.cross(z[i], z[j])))
        along = float(z[i] @ z[j])
        if abs(along) > TURNED if words == "across" else across > TURNED or along < 0.0:
            layout = f"its axis is not {words} that of {joints[j].name}, as on an arm of Universal Robots"
            raise UrdfRefused(f"joint {joints[i].name}: at position 0 {layout}")
    up = z[0]
    ahead = np.cross(-z[1], up)
    ahead = ahead / np.linalg.norm(ahead)
    lengths = {
        "dh_a_m": [0.0, float((p[2] - p[1]) @ ahead), float((p[3] - p[2]) @ ahead), 0.0, 0.0, 0.0],
        "dh_d_m": [
            float(p[1] @ up),
            0.0,
            0.0,
            float(p[4] @ z[3]),
            float((p[5] - p[3]) @ z[4]),
            float((flange[:3, 3] - p[4]) @ z[5]),
        ],
    }
    return {key: [round(value, 9) + 0.0 for value in values] for key, values in lengths.items()}


def _model(tree: UrdfTree, lengths: Mapping[str, list[float]]) -> tuple[str, list[str]]:
    """Returns the model whose published lengths are closest, and what to note of it.

    A file that is named like a model means that one, where others have the same lengths or its own are not published.
    """
    said = tree.name.lower().replace("-", "_")
    if said in INCOMPLETE_NAMES and published_number(said, "dh_a_m") is None:
        return said, []
    apart_m = {}
    for name in (*ROBOT_NAMES, *INCOMPLETE_NAMES):
        known = [published_number(name, key) for key in ("dh_a_m", "dh_d_m")]
        if None not in known:
            apart_m[name] = float(np.abs(np.subtract([lengths["dh_a_m"], lengths["dh_d_m"]], known)).max())
    nearest = min(apart_m, key=apart_m.__getitem__)
    if apart_m[nearest] > LIKE_M:
        others = " or ".join(name for name in INCOMPLETE_NAMES if name not in apart_m)
        reason = f"the closest, that of the {nearest}, differs by {1e3 * apart_m[nearest]:.0f} mm"
        raise UrdfRefused(f"its kinematics are none that is published: {reason}; --robot can say that it is a {others}")
    alike = [name for name, m in apart_m.items() if m <= apart_m[nearest] + ALIKE_M]
    if len(alike) == 1 or said in alike:
        return (said if said in alike else nearest), []
    return nearest, [f"its kinematics are those of {' and '.join(alike)}: --robot says which it is"]


def _limits(joints: Sequence[UrdfJoint]) -> dict[str, list[float]]:
    """Returns the limits that the file gives of all six joints."""
    columns = {
        "joint_position_lower_deg": [joint.lower for joint in joints],
        "joint_position_upper_deg": [joint.upper for joint in joints],
        "joint_velocity_deg_s": [joint.velocity or None for joint in joints],
        "joint_torque_n_m": [joint.effort or None for joint in joints],
    }
    found = {}
    for key, values in columns.items():
        known = [value for value in values if value is not None]
        if len(known) == 6:
            found[key] = known if key == "joint_torque_n_m" else [round(float(np.degrees(x)), 9) for x in known]
    return found


def _masses(tree: UrdfTree, joints: Sequence[UrdfJoint], X_RB: Array, fixed: Array) -> dict[str, Any]:
    """Returns the masses of the links in the frames of a chain (6, 4, 4); none where the file lacks one."""
    found: dict[str, list[Any]] = {"link_mass_kg": [], "link_com_m": [], "link_inertia_kg_m2": []}
    X_BL = np.eye(4)
    for joint, M in zip(joints, fixed, strict=True):
        X_BL = X_BL @ M
        body = tree.bodies[joint.child]
        if body is None or body.mass == 0.0:
            return {}
        X = invert_pose(X_RB @ X_BL) @ tree.pose(joint.child)
        inertia = X[:3, :3] @ body.inertia @ X[:3, :3].T
        found["link_mass_kg"].append(body.mass)
        found["link_com_m"].append(_rounded(X[:3, :3] @ body.com + X[:3, 3]))
        found["link_inertia_kg_m2"].append(_rounded(inertia[np.triu_indices(3)]))
    return found


def _rounded(x: Array) -> list[float]:
    return [round(float(value), 12) + 0.0 for value in x]


def _with_numbers(
    name: str, given: Mapping[str, Any], tree: UrdfTree, joints: Sequence[UrdfJoint]
) -> tuple[Robot, dict[str, Any]]:
    """Returns the arm, and those numbers of the file that add to what is published of it.

    Raises:
        UrdfRefused: it lacks numbers that are not published.
    """
    numbers = {
        key: value for key, value in given.items() if key.startswith("link_") or published_number(name, key) is None
    }
    if name in ROBOT_NAMES and not _has_other_masses(robot(name), numbers):
        numbers = {key: value for key, value in numbers.items() if not key.startswith("link_")}
    try:
        return completed(name, numbers), numbers
    except IncompleteRobot as error:
        lacking = " and ".join(_lacking(error.missing, tree, joints))
        ways = f"fill it in, or write a cell file: its [arm_data] takes {', '.join(error.missing)}, with their source"
        raise UrdfRefused(f"lacks {lacking}, and for a {name} that is not published: {ways}") from error


def _lacking(missing: Sequence[str], tree: UrdfTree, joints: Sequence[UrdfJoint]) -> list[str]:
    """Returns what a file lacks, in its own words, with the joints or links that lack it."""
    massless = [j.child for j in joints if (body := tree.bodies[j.child]) is None or body.mass == 0.0]
    lacking = {
        "joint_velocity_deg_s": ("a velocity above 0 in the <limit>", [j.name for j in joints if not j.velocity]),
        "joint_torque_n_m": ("an effort above 0 in the <limit>", [j.name for j in joints if not j.effort]),
        "link_mass_kg": ("a mass above 0 in the <inertial>", massless),
    }
    return [f"{words} of {', '.join(names)}" for key, (words, names) in lacking.items() if key in missing]


def _has_other_masses(arm: Robot, numbers: Mapping[str, Any]) -> bool:
    if "link_mass_kg" not in numbers:
        return False
    own = [[link.mass, *link.com, *link.inertia[np.triu_indices(3)]] for link in arm.links]
    rows = zip(*(numbers[key] for key in ("link_mass_kg", "link_com_m", "link_inertia_kg_m2")), strict=True)
    given = [[mass, *com, *inertia] for mass, com, inertia in rows]
    return bool(np.abs(np.subtract(given, own)).max() > SAME_MASS)


def _notes_on_masses(name: str, masses: Mapping[str, Any], numbers: Mapping[str, Any]) -> list[str]:
    if not masses:
        return [f"it does not give the mass of every link: those published of a {name} are used"]
    if "link_mass_kg" in numbers and name in ROBOT_NAMES:
        return [f"its masses are not those published of a {name}, or not at the same places: [arm_data] has them"]
    return []
