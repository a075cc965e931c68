"""Calibration files in the format of Universal Robots' ROS driver (YAML).

    kinematics:
      shoulder: {x: 0, y: 0, z: 0.1625, roll: 0, pitch: 0, yaw: 0}    # pose of joint 1 in the base [m, rad]
      upper_arm: ...                                                  # of joint 2 in the link before, and so on
      hash: calib_12788084448423163542

A rotation is Rz(yaw) Ry(pitch) Rx(roll); each joint then turns about z; the last link's frame is the flange. A table
whose last row has a length or a twist needs one pose more: it is written as `flange`, which drivers ignore.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.calibration.chain import ImplausibleChain, calibrated, transforms_of_links
from planner.calibration.dh_table import turn_z
from planner.errors import CellError
from planner.robots import Robot
from planner.rotations import invert_pose, pose, roll_pitch_yaw_to_matrix

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")
FLANGE_ROUNDING = 1e-12  # [m, rad] a flange this close to the last link's frame is left out of a file


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration file: its name, and the hash by which UR's drivers know the arm; None where it has none."""

    name: str
    hash: str | None


def parse_calibration(text: bytes, name: str, robot: Robot) -> tuple[CalibrationFile, Robot]:
    """Returns what a file says, and the arm with the file's chain.

    Args:
        text: content of the file.
        name: of the file, for error messages.
        robot: the published arm.

    Raises:
        CellError: the file is not YAML, an entry is missing, unknown or no finite number, or the chain is not that of
            an arm of this model.
    """
    kinematics = dict(_kinematics(text, name))
    given_hash = kinematics.pop("hash", None)
    flange = _pose(kinematics.pop("flange"), f"{name}: kinematics.flange") if "flange" in kinematics else np.eye(4)
    for key in kinematics:
        if key not in LINKS:
            raise CellError(f"{name}: kinematics.{key}", None, f"unknown link; known are {', '.join(LINKS)}")
    for link in LINKS:
        if link not in kinematics:
            raise CellError(f"{name}: kinematics.{link}", None, "is missing")
    links = [_pose(kinematics[link], f"{name}: kinematics.{link}") for link in LINKS]
    try:
        arm = calibrated(robot, transforms_of_links(links, flange))
    except ImplausibleChain as error:
        raise CellError("kinematics.calibration", name, f"is no {robot.name}: {error}") from error
    return CalibrationFile(name, None if given_hash is None else str(given_hash)), arm


def _kinematics(text: bytes, name: str) -> Mapping[str, Any]:
    import yaml  # with the first calibrated cell: other cells do without

    try:
        document = yaml.load(text.decode(), yaml.BaseLoader)  # texts alone: no dates, which may be wrong, no numbers
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise CellError("kinematics.calibration", name, f"is not YAML: {' '.join(str(error).split())}") from error
    except RecursionError:
        raise CellError("kinematics.calibration", name, "nests too deep") from None
    kinematics = document.get("kinematics") if isinstance(document, Mapping) else None
    if not isinstance(kinematics, Mapping):
        raise CellError("kinematics.calibration", name, "has no mapping `kinematics`")
    return kinematics


def _pose(entry: object, where: str) -> Array:
    if not isinstance(entry, Mapping) or set(entry) != set(COORDINATES):
        raise CellError(where, entry, f"must have exactly {', '.join(COORDINATES)}")
    x, y, z, roll, pitch, yaw = (_number(entry[key], f"{where}.{key}") for key in COORDINATES)
    return pose([x, y, z], roll_pitch_yaw_to_matrix(roll, pitch, yaw))


def _number(value: object, where: str) -> float:
    """Returns a finite number."""
    try:
        number = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise CellError(where, value, "must be a finite number")
    return number


def calibration_text(fixed: Array, hash: str) -> str:
    """Returns the file of a chain's fixed transforms (6, 4, 4), every number exact.

    Args:
        fixed: the transforms, frames placed as by `calibrated`.
        hash: the driver's name of the calibration.
    """
    links, flange = _links_of(fixed)
    poses: dict[str, Array] = dict(zip(LINKS, links, strict=True))
    if np.abs(flange - np.eye(4)).max() > FLANGE_ROUNDING:
        poses["flange"] = flange
    lines = ["kinematics:"]
    for name, X in poses.items():
        lines += [f"  {name}:", *(f"    {key}: {_text(value)}" for key, value in _coordinates(X).items())]
    return "\n".join([*lines, f"  hash: {hash}", ""])


def _links_of(fixed: Array) -> tuple[list[Array], Array]:
    """Returns the poses of the joints in the links before them as in URDF, and of the flange in the last link.

    A joint sits where its own offset d leads, so that a published table gives the published file.
    """
    slides = [np.eye(4) for _ in fixed]
    for slide, M in zip(slides, fixed, strict=True):
        slide[2, 3] = M[2, 3]
    last = fixed[5]
    slides[5] = slides[5] @ turn_z(float(np.arctan2(last[1, 0], last[0, 0])))
    beyond = [invert_pose(slide) @ M for slide, M in zip(slides, fixed, strict=True)]
    return [slides[0], *(beyond[i] @ slides[i + 1] for i in range(5))], beyond[5]


def _coordinates(X: Array) -> dict[str, float]:
    """Returns x, y, z [m] and roll, pitch, yaw [rad] of a pose (4, 4)."""
    R = X[:3, :3]
    level = math.hypot(R[0, 0], R[1, 0])
    roll = math.atan2(R[2, 1], R[2, 2])
    pitch = math.atan2(-R[2, 0], level)
    yaw = math.atan2(R[1, 0], R[0, 0])
    return dict(zip(COORDINATES, (*X[:3, 3].tolist(), roll, pitch, yaw), strict=True))


def _text(value: float) -> str:
    """Returns a number that every YAML reader takes for one: with a point before its exponent."""
    text = repr(float(value) + 0.0)  # no minus before a zero
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
