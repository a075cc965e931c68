"""Kind `pose`: pass a tool pose with a twist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array
from planner.errors import FieldError
from planner.fields import Field, Record, Vector, required
from planner.geometry import ToolState
from planner.releases.release import Bound, Release, ReleaseSample, between, turn
from planner.rotations import (
    angle_between,
    beyond_full_turn,
    matrix_to_quaternion,
    matrix_to_rotation_vector,
    pose,
    quaternion_to_matrix,
    rotation_vector_to_matrix,
)

AGREEMENT_RAD = 1e-3  # [rad] by which two orientations of one pose may differ: somebody rounded them
UNIT_TOLERANCE = 1e-3  # [-] deviation of a quaternion's length from 1 up to which it is normalised


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
    found = orientations(given)
    apart = angle_between(found[0], found[-1])
    if apart > AGREEMENT_RAD:
        errors.append(FieldError(path, f"quaternion and rotation_vector are {apart:.3g} rad apart"))


def orientations(given: Mapping[str, Any]) -> list[Array]:
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


def pose_document(X_WT: Array) -> dict[str, Any]:
    """Returns a pose (4, 4) as JSON."""
    return {"position": X_WT[:3, 3].tolist(), "quaternion": matrix_to_quaternion(X_WT[:3, :3]).tolist()}


@dataclass(frozen=True, eq=False)
class PoseRelease(Release):
    """Release at the tool pose `X_WT` (4, 4) with the twist `V_WT` (6,): linear [m/s], then angular [rad/s]."""

    X_WT: Array
    V_WT: Array

    name: ClassVar[str] = "pose"
    record: ClassVar[Record] = Record(
        "PoseReleaseRequest",
        "Pass a tool pose with a twist.",
        {
            "pose": required(POSE, "Pose of the tool centre point at the release, in `frame`."),
            "twist": required(TWIST, "Twist of the tool centre point at the release, in `frame`."),
        },
    )

    @property
    def tool_state(self) -> ToolState:
        """The tool's pose and twist."""
        return ToolState(self.X_WT, self.V_WT)

    def slower(self, share: float) -> Self:
        """Returns this release with a share of its twist."""
        return replace(self, V_WT=share * self.V_WT)

    def moved_to(self, p_WT: Array) -> Self:
        """Returns this release at another position, in the same orientation."""
        return replace(self, X_WT=pose(p_WT, self.X_WT[:3, :3]))

    def towards(self, q_0: Array, X_W0: Array, share: float) -> Self:
        """Returns this release at a share of the way from a tool pose, position and orientation."""
        angle = share * matrix_to_rotation_vector(self.X_WT[:3, :3] @ X_W0[:3, :3].T)
        R_WT = rotation_vector_to_matrix(angle) @ X_W0[:3, :3]
        return replace(self, X_WT=pose(between(X_W0[:3, 3], self.X_WT[:3, 3], share), R_WT))

    def position_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the deviations of position and orientation."""
        offset = float(np.linalg.norm(at.tool.p_WT - self.X_WT[:3, 3]))
        angle = float(angle_between(at.tool.X_WT[:3, :3], self.X_WT[:3, :3]))
        return [Bound(offset, 0.0, "m", "position [m]"), Bound(angle, 0.0, "rad", "orientation [rad]")]

    def velocity_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the largest deviations of a component of linear and of angular velocity."""
        off = np.abs(at.tool.V_WT - self.V_WT)
        return [Bound(float(off[:3].max()), 0.0, "m/s"), Bound(float(off[3:].max()), 0.0, "rad/s")]

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release in the world."""
        X_RT = pose(np.array(given["pose"]["position"]), orientations(given["pose"])[0])
        v_WT = turn(X_WR, given["twist"]["linear"])
        w_WT = turn(X_WR, given["twist"]["angular"])
        return cls(X_WR @ X_RT, np.concatenate([v_WT, w_WT]))

    def to_json(self) -> dict[str, Any]:
        """Returns pose and twist in the world."""
        V = self.V_WT
        return {
            "pose": pose_document(self.X_WT),
            "twist": {"linear": V[:3].tolist(), "angular": V[3:].tolist()},
        }
