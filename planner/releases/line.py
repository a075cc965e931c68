"""A straight line at constant speed: passed like a pose with a twist, from which it goes on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array
from planner.errors import FieldError
from planner.fields import Number, Record, required
from planner.releases.pose import POSE, PoseRelease, orientations, pose_document
from planner.rotations import angle_between, matrix_to_rotation_vector, pose, rotation_vector_to_matrix

LENGTH_MIN_M = 1e-3  # [m] a shorter line is a state
ROUNDING = 1e-9  # [-] of a length in floating point
TURN_MAX_RAD = math.pi - 1e-3  # [rad] beyond it rounding would decide which way round the tool turns
DURATION_MAX_S = 40.0  # [s] of a line; as long as a leg may take at 500 Hz


def _check_line(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    """Refuses a line without a direction, with an open sense of rotation, or that lasts too long."""
    length = math.dist(given["from"]["position"], given["to"]["position"])
    turn = angle_between(orientations(given["from"])[0], orientations(given["to"])[0])
    if length < LENGTH_MIN_M * (1.0 - ROUNDING):
        errors.append(FieldError(f"{path}.to", f"is {length:g} m from the start; a line is {LENGTH_MIN_M:g} m or more"))
    elif length > DURATION_MAX_S * given["speed_m_s"]:
        lasts_s = length / given["speed_m_s"]
        reason = f"{length:g} m would take {lasts_s:.3g} s; a line takes {DURATION_MAX_S:g} s at most"
        errors.append(FieldError(f"{path}.speed_m_s", reason))
    if turn > TURN_MAX_RAD:
        errors.append(FieldError(f"{path}.to", f"is turned by {turn:.3g} rad: which way round is open; give two lines"))


@dataclass(frozen=True, eq=False)
class SteadyLine(PoseRelease):
    """A straight line of the tool centre point at constant speed, while the tool turns evenly about one axis.

    Pose and twist are those at its start; the twist is the same all along.

    Attributes:
        X_WE: tool pose (4, 4) at its end.
        speed_m_s: speed of the tool centre point [m/s].
    """

    X_WE: Array
    speed_m_s: float

    name: ClassVar[str] = "line"
    record: ClassVar[Record] = Record(
        "LineRequest",
        "A straight line of the tool at constant speed. From one orientation to the other it turns evenly, about one "
        "axis. It begins on a tick and goes straight on to the first tick that is not before its end.",
        {
            "from": required(POSE, "Pose of the tool centre point at the start, in `frame`."),
            "to": required(POSE, "Pose at the end, in `frame`."),
            "speed_m_s": required(Number(above=0.0), "Speed of the tool centre point [m/s]."),
        },
        _check_line,
    )

    @cached_property
    def length_m(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.X_WE[:3, 3] - self.X_WT[:3, 3]))

    @property
    def lasts_s(self) -> float:
        """Time from its start to its end [s]."""
        return self.length_m / self.speed_m_s

    @property
    def end_state(self) -> PoseRelease:
        """Pose and twist at the end."""
        return PoseRelease(self.X_WE, self.V_WT)

    def poses(self, t: Array) -> Array:
        """Returns tool poses (k, 4, 4) at times (k,) after the start [s], also beyond the end."""
        moved = t[:, None] * self.V_WT
        return pose(self.X_WT[:3, 3] + moved[:, :3], rotation_vector_to_matrix(moved[:, 3:]) @ self.X_WT[:3, :3])

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the line in the world."""
        X_WT, X_WE = (
            X_WR @ pose(np.array(given[end]["position"]), orientations(given[end])[0]) for end in ("from", "to")
        )
        way = X_WE[:3, 3] - X_WT[:3, 3]
        turn = matrix_to_rotation_vector(X_WE[:3, :3] @ X_WT[:3, :3].T)
        speed = given["speed_m_s"]
        return cls(X_WT, np.concatenate([way, turn]) * (speed / np.linalg.norm(way)), X_WE, speed)

    def to_json(self) -> dict[str, Any]:
        """Returns both ends in the world, and the speed."""
        return {"from": pose_document(self.X_WT), "to": pose_document(self.X_WE), "speed_m_s": self.speed_m_s}
