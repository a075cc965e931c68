"""The JSON of each release kind: its fields, what they say in the planner's types, and how it is written.

A kind is one entry of `KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from math import inf, pi
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.errors import FieldError
from planner.fields import Field, Number, Record, Vector, required
from planner.problem import JointRelease, Opening, PointRelease, PoseRelease, Release, TargetRelease
from planner.rotations import (
    angle_between,
    beyond_full_turn,
    matrix_to_quaternion,
    pose,
    quaternion_to_matrix,
    rotation_vector_to_matrix,
)

AGREEMENT_RAD = 1e-3  # [rad] by which two orientations of one pose may differ: somebody rounded them
UNIT_TOLERANCE = 1e-3  # [-] deviation of a quaternion's length from 1 up to which it is normalised
SPEED_MIN_M_S = 1e-3  # [m/s] lowest bound on the release speed
OPENING_MAX_M = 10.0  # [m] largest radius and rim height of a bin; catches typing errors


@dataclass(frozen=True)
class ReleaseKind:
    """One release kind as JSON.

    Attributes:
        record: its fields, without `kind`.
        release: its class.
        read: returns the release in the world, given the fields and `X_WR`, the pose of the request's frame.
        write: returns the fields of a release in the world.
    """

    record: Record
    release: type[Release]
    read: Callable[[Mapping[str, Any], Array], Release]
    write: Callable[[Any], dict[str, Any]]


def release_document(release: Release) -> dict[str, Any]:
    """Returns a release in the shape of `POST /plan`, in the world frame."""
    name, kind = next((name, kind) for name, kind in KINDS.items() if isinstance(release, kind.release))
    return {"kind": name, **kind.write(release)}


def _check_orientation(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    """Refuses a pose without an orientation, a wrong one, and two that do not agree."""
    quaternion = given.get("quaternion")
    vector = given.get("rotation_vector")
    if quaternion is None and vector is None:
        errors.append(FieldError(path, "give quaternion or rotation_vector"))
        return
    if quaternion is not None and abs((length := float(np.linalg.norm(quaternion))) - 1.0) > UNIT_TOLERANCE:
        errors.append(FieldError(f"{path}.quaternion", f"has length {length:g}, must be 1"))
        return
    if vector is not None and (reason := beyond_full_turn(np.array(vector))):
        errors.append(FieldError(f"{path}.rotation_vector", reason))
        return
    found = _orientations(given)
    apart = angle_between(found[0], found[-1])
    if apart > AGREEMENT_RAD:
        errors.append(FieldError(path, f"quaternion and rotation_vector are {apart:.3g} rad apart"))


def _orientations(given: Mapping[str, Any]) -> list[Array]:
    """Returns the rotation matrices that a pose gives: answers give both."""
    found = []
    if "quaternion" in given:
        quaternion = np.array(given["quaternion"])
        found.append(quaternion_to_matrix(quaternion / np.linalg.norm(quaternion)))
    if "rotation_vector" in given:
        found.append(rotation_vector_to_matrix(np.array(given["rotation_vector"])))
    return found


POSE = Record(
    "Pose",
    "Position and orientation of the tool centre point.",
    {
        "position": required(Vector(3), "Position [m]."),
        "quaternion": Field(Vector(4), "Orientation as a unit quaternion [x, y, z, w] [-]."),
        "rotation_vector": Field(
            Vector(3), "Orientation as UR's rotation vector [rad]. Answers give both, which must agree."
        ),
    },
    _check_orientation,
)
TWIST = Record(
    "Twist",
    "Velocity of the tool centre point.",
    {
        "linear": required(Vector(3), "Linear velocity [m/s]."),
        "angular": required(Vector(3), "Angular velocity [rad/s]."),
    },
)
OPENING = Record(
    "OpeningRequest",
    "Mouth of a round bin that is open upwards; the target is the centre of its bottom.",
    {
        "radius_m": required(
            Number(above=0.0, most=OPENING_MAX_M), "Inner radius of the bin [m]; above the object's radius."
        ),
        "rim_height_m": required(Number(0.0, OPENING_MAX_M), "Height of the rim above the target [m]."),
    },
)
POSE_RELEASE = Record(
    "PoseReleaseRequest",
    "Pass a tool pose with a twist.",
    {
        "pose": required(POSE, "Pose of the tool centre point at the release, in `frame`."),
        "twist": required(TWIST, "Twist of the tool centre point at the release, in `frame`."),
    },
)
POINT_RELEASE = Record(
    "PointReleaseRequest",
    "Pass a point with a velocity; orientation and angular velocity are free.",
    {
        "position": required(Vector(3), "Position of the tool centre point at the release, in `frame` [m]."),
        "velocity": required(Vector(3), "Its velocity, in `frame` [m/s]."),
    },
)
JOINT_RELEASE = Record(
    "JointReleaseRequest",
    "Pass a joint state.",
    {
        "positions": required(Vector(6), "Joint positions at the release [rad]."),
        "velocities": required(Vector(6), "Joint velocities at the release [rad/s]."),
    },
)
TARGET_RELEASE = Record(
    "TargetReleaseRequest",
    "Hit a point by free flight; the planner chooses the release.",
    {
        "position": required(Vector(3), "The point to hit, in `frame` [m]."),
        "max_release_speed_m_s": Field(Number(SPEED_MIN_M_S), "Maximum speed of the object at the release [m/s]."),
        "min_elevation_rad": Field(
            Number(-pi / 2, pi / 2), "Minimum elevation of the release velocity above the horizon [rad]."
        ),
        "max_elevation_rad": Field(
            Number(-pi / 2, pi / 2), "Maximum elevation of the release velocity above the horizon [rad]."
        ),
        "min_horizontal_distance_m": Field(
            Number(0.0), "Minimum horizontal distance from the release to the target [m]."
        ),
        "release_position": Field(Vector(3), "Position of the release, in `frame` [m]; absent: free."),
        "opening": Field(
            OPENING, "The bin around the target: the object enters through its mouth, clear of rim and wall."
        ),
    },
)


def _read_pose(given: Mapping[str, Any], X_WR: Array) -> Release:
    X_RT = pose(np.array(given["pose"]["position"]), _orientations(given["pose"])[0])
    v_WT = _turn(X_WR, given["twist"]["linear"])
    w_WT = _turn(X_WR, given["twist"]["angular"])
    return PoseRelease(X_WR @ X_RT, np.concatenate([v_WT, w_WT]))


def _write_pose(release: PoseRelease) -> dict[str, Any]:
    X = release.X_WT
    V = release.V_WT
    return {
        "pose": {"position": X[:3, 3].tolist(), "quaternion": matrix_to_quaternion(X[:3, :3]).tolist()},
        "twist": {"linear": V[:3].tolist(), "angular": V[3:].tolist()},
    }


def _read_point(given: Mapping[str, Any], X_WR: Array) -> Release:
    return PointRelease(_move(X_WR, given["position"]), _turn(X_WR, given["velocity"]))


def _write_point(release: PointRelease) -> dict[str, Any]:
    return {"position": release.p_WT.tolist(), "velocity": release.v_WT.tolist()}


def _read_joint(given: Mapping[str, Any], X_WR: Array) -> Release:
    return JointRelease(read_only(given["positions"]), read_only(given["velocities"]))


def _write_joint(release: JointRelease) -> dict[str, Any]:
    return {"positions": release.q.tolist(), "velocities": release.qd.tolist()}


def _read_target(given: Mapping[str, Any], X_WR: Array) -> Release:
    return TargetRelease(
        p_W=_move(X_WR, given["position"]),
        max_speed_m_s=given.get("max_release_speed_m_s", inf),
        min_elevation_rad=given.get("min_elevation_rad", -pi / 2),
        max_elevation_rad=given.get("max_elevation_rad", pi / 2),
        min_horizontal_distance_m=given.get("min_horizontal_distance_m", 0.0),
        release_position=_move(X_WR, given["release_position"]) if "release_position" in given else None,
        opening=Opening(**given["opening"]) if "opening" in given else None,
    )


def _write_target(release: TargetRelease) -> dict[str, Any]:
    document: dict[str, Any] = {
        "position": release.p_W.tolist(),
        "min_elevation_rad": release.min_elevation_rad,
        "max_elevation_rad": release.max_elevation_rad,
        "min_horizontal_distance_m": release.min_horizontal_distance_m,
    }
    if np.isfinite(release.max_speed_m_s):
        document["max_release_speed_m_s"] = release.max_speed_m_s
    if release.release_position is not None:
        document["release_position"] = release.release_position.tolist()
    if release.opening is not None:
        document["opening"] = asdict(release.opening)
    return document


def _move(X_WR: Array, p: list[float]) -> Array:
    """Returns a point of the request's frame in the world frame."""
    return X_WR[:3, :3] @ np.array(p) + X_WR[:3, 3]


def _turn(X_WR: Array, v: list[float]) -> Array:
    """Returns a vector of the request's frame in the world frame."""
    return X_WR[:3, :3] @ np.array(v)


KINDS = {
    "pose": ReleaseKind(POSE_RELEASE, PoseRelease, _read_pose, _write_pose),
    "point": ReleaseKind(POINT_RELEASE, PointRelease, _read_point, _write_point),
    "joint": ReleaseKind(JOINT_RELEASE, JointRelease, _read_joint, _write_joint),
    "target": ReleaseKind(TARGET_RELEASE, TargetRelease, _read_target, _write_target),
}
