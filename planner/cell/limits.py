"""The tables `[limits]` and `[safety]` of a cell file: what bounds a motion.

A safety limit is a field of `Safety` and a line in `SAFETY_LIMITS`: reading, certificate, optimiser and API know it
from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, read_only
from planner.cell.fields import beyond_arm, number, optional, per_joint, vector
from planner.errors import CellError
from planner.robots import Robot

LIMITS: dict[str, Any] = {  # values of the keys that a cell file leaves out; None: the arm's own
    "joint_position_lower_rad": None,
    "joint_position_upper_rad": None,
    "joint_velocity_rad_s": None,
    "joint_acceleration_rad_s2": 15.0,
    "joint_jerk_rad_s3": 500.0,
    "joint_torque_fraction": 0.9,
    "tcp_speed_m_s": 4.0,
    "singularity_distance_min": 0.05,
}
LIMIT_ROUNDING = 1e-9  # [-] of a limit that was written as text with twelve digits
STANDING_RAD = 1e-3  # [rad] by which an arm may stand beyond its range; its controller lets it no farther, and back
JERK_MAX = 1e5  # [rad/s^3] far above any arm; catches typing errors
SPEED_MAX = 20.0  # [m/s] far above any arm; catches typing errors


class LimitBeyondArm(NamedTuple):
    """A limit of one joint that the arm itself does not have: its attribute of `Limits`, the joint, and both values."""

    attribute: str
    joint: int
    value: float
    own: float


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds on the motion.

    Attributes:
        q_lower, q_upper: joint positions (6,) [rad].
        qd_max: joint velocities (6,) [rad/s].
        qdd_max: joint accelerations (6,) [rad/s^2].
        jerk_max: joint jerks (6,) [rad/s^3].
        tau_max: joint torques (6,) [N m].
        tcp_speed_max: speed of the tool centre point [m/s], the arm's own tool speed limit included.
        singularity_distance_min: distance to each singularity [-].
    """

    q_lower: Array
    q_upper: Array
    qd_max: Array
    qdd_max: Array
    jerk_max: Array
    tau_max: Array
    tcp_speed_max: float
    singularity_distance_min: float

    def within(self, arm: Robot) -> Limits:
        """Returns these limits, no wider than what is published of the arm's model; see `STANDING_RAD`."""
        own = arm.published
        return replace(
            self,
            q_lower=np.maximum(self.q_lower, own.q_lower - STANDING_RAD),
            q_upper=np.minimum(self.q_upper, own.q_upper + STANDING_RAD),
            qd_max=np.minimum(self.qd_max, own.qd_max),
            qdd_max=np.minimum(self.qdd_max, own.qdd_max),
            tau_max=np.minimum(self.tau_max, own.tau_max),
        )

    def beyond(self, arm: Robot, standing_rad: float = 0.0) -> list[LimitBeyondArm]:
        """Returns every limit that is wider than what is published of the arm's model, or is no number.

        Args:
            arm: of that model.
            standing_rad: by which a range may be wider than the arm's [rad].
        """
        own = arm.published
        found = []
        for name in ("q_lower", "q_upper", "qd_max", "qdd_max", "tau_max"):
            value = getattr(self, name)
            bound = getattr(own, name)
            slack = (standing_rad if name.startswith("q_") else 0.0) + LIMIT_ROUNDING * np.abs(bound)
            is_kept = value >= bound - slack if name == "q_lower" else value <= bound + slack
            joints = np.flatnonzero(~is_kept).tolist()
            found += [LimitBeyondArm(name, joint, float(value[joint]), float(bound[joint])) for joint in joints]
        return found


@dataclass(frozen=True)
class Safety:
    """The arm's own safety limits, as its pendant shows them; None: not limited.

    Attributes:
        tool_speed_m_s, elbow_speed_m_s: speeds [m/s].
        momentum_kg_m_s: [kg m/s].
        power_w: [W].
        stopping_time_s: [s].
        stopping_distance_m: [m].
    """

    tool_speed_m_s: float | None = None
    elbow_speed_m_s: float | None = None
    momentum_kg_m_s: float | None = None
    power_w: float | None = None
    stopping_time_s: float | None = None
    stopping_distance_m: float | None = None


class SafetyLimit(NamedTuple):
    """What is known of one of the arm's own safety limits.

    Attributes:
        check: of the certificate, which holds every motion to it.
        unit: of the limit.
        most: that a cell file may state, far above what a pendant takes; catches typing errors.
        growth: power of the tool's speed with which the quantity grows in the same posture [-].
    """

    check: str
    unit: str
    most: float
    growth: float


SAFETY_LIMITS = {  # by their keys
    "tool_speed_m_s": SafetyLimit("tcp_speed", "m/s", SPEED_MAX, 1.0),
    "elbow_speed_m_s": SafetyLimit("elbow_speed", "m/s", SPEED_MAX, 1.0),
    "momentum_kg_m_s": SafetyLimit("momentum", "kg m/s", 1e3, 1.0),
    "power_w": SafetyLimit("power", "W", 1e4, 1.0),
    "stopping_time_s": SafetyLimit("stopping_time", "s", 10.0, 1.0),
    "stopping_distance_m": SafetyLimit("stopping_distance", "m", 10.0, 2.0),
}


def limits_of(table: dict[str, Any], arm: Robot) -> Limits:
    """Returns the limits that the table describes; fills in those of the arm.

    Raises:
        CellError: a field is refused, or beyond the arm's own limit.
    """
    own = {
        "joint_position_lower_rad": arm.q_lower,
        "joint_position_upper_rad": arm.q_upper,
        "joint_velocity_rad_s": arm.qd_max,
    }
    for key, values in own.items():
        table[key] = values.tolist() if table[key] is None else table[key]
    where = "limits."
    lower = vector(table, "joint_position_lower_rad", where, 6)
    upper = vector(table, "joint_position_upper_rad", where, 6)
    for i in range(6):
        if lower[i] < arm.q_lower[i]:
            raise beyond_arm(f"{where}joint_position_lower_rad[{i}]", float(lower[i]), arm.q_lower[i])
        if upper[i] > arm.q_upper[i]:
            raise beyond_arm(f"{where}joint_position_upper_rad[{i}]", float(upper[i]), arm.q_upper[i])
        if lower[i] >= upper[i]:
            raise CellError(f"{where}joint_position_lower_rad[{i}]", float(lower[i]), "must be below the upper limit")
    fraction = number(table, "joint_torque_fraction", where, 0.01, 1.0)
    return Limits(
        q_lower=lower,
        q_upper=upper,
        qd_max=per_joint(table, "joint_velocity_rad_s", where, arm.qd_max),
        qdd_max=per_joint(table, "joint_acceleration_rad_s2", where, arm.qdd_max),
        jerk_max=per_joint(table, "joint_jerk_rad_s3", where, np.full(6, JERK_MAX)),
        tau_max=read_only(fraction * arm.tau_max),
        tcp_speed_max=number(table, "tcp_speed_m_s", where, 1e-3, SPEED_MAX),
        singularity_distance_min=number(table, "singularity_distance_min", where, 0.0, 1.0),
    )


def safety_of(table: Mapping[str, Any]) -> Safety:
    """Returns the arm's own safety limits that the table describes.

    Raises:
        CellError: a field is refused.
    """
    return Safety(**{key: optional(table, key, "safety.", limit.most) for key, limit in SAFETY_LIMITS.items()})
