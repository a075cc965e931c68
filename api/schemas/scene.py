"""Documents for pictures: the model of a cell, the curves of a plan."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, create_model

from api.schemas.requests import Joints, Vector3
from planner.cell import SAFETY_LIMITS

Row = Annotated[list[float], Field(min_length=4, max_length=4)]
Transform = Annotated[list[Row], Field(min_length=4, max_length=4)]


class CapsuleAnswer(BaseModel):
    """All points within a radius of a segment, in the frame of one link."""

    name: str = Field(description="Of the link's part; `tool_0`, `tool_1`, … of the tool's capsules; `object`.")
    part: Literal["arm", "tool", "object"]
    frame: int = Field(ge=0, le=6, description="Link that it moves with: 0 is the base, 6 the flange.")
    from_m: Vector3 = Field(description="One end of the segment, in that frame [m].")
    to_m: Vector3 = Field(description="The other end [m].")
    radius_m: float = Field(description="[m]")


class CellLimits(BaseModel):
    """Limits of the cell; a request may tighten them."""

    position_lower_rad: Joints = Field(description="[rad]")
    position_upper_rad: Joints = Field(description="[rad]")
    velocity_rad_s: Joints = Field(description="[rad/s]")
    acceleration_rad_s2: Joints = Field(description="[rad/s^2]")
    jerk_rad_s3: Joints = Field(description="[rad/s^3]")
    torque_n_m: Joints = Field(description="[N m]")
    tcp_speed_m_s: float = Field(description="Speed of the tool centre point [m/s].")
    singularity_distance_min: float = Field(description="[-]")


SAFETY_FIELDS: dict[str, Any] = {
    key: (float | None, Field(description=f"[{limit.unit}]")) for key, limit in SAFETY_LIMITS.items()
}


class SafetyLimitsAnswer(create_model("SafetyFields", **SAFETY_FIELDS)):
    """The arm's own safety limits; null: not limited."""


class BoxAnswer(BaseModel):
    """An axis-aligned box in the world."""

    lower_m: Vector3 = Field(description="Lower corner [m].")
    upper_m: Vector3 = Field(description="Upper corner [m].")


class ShapeAnswer(BoxAnswer):
    """A convex body, and the axis-aligned box in the world that bounds it."""

    name: str = Field(description="As violations and checks tell it.")
    shape: Literal["box", "cylinder", "sphere", "capsule"]
    pose: Transform = Field(description="Pose of its centre and axes in the world; rows [m].")
    extent_m: Vector3 = Field(description="Its extent along its own axes, round ends included; z is a cylinder's [m].")
    clearance_m: float = Field(description="Least distance to it, or to its walls from within [m].")


class SurroundingsAnswer(BaseModel):
    """Floor, shapes and gravity, in the world."""

    floor_z_m: float = Field(description="Height of the floor [m].")
    clearance_m: float = Field(description="Least distance to the floor, and to shapes without their own [m].")
    gravity_m_s2: float = Field(description="Along -z [m/s^2].")
    keep_in: list[ShapeAnswer] = Field(description="The tool centre point stays in every one.")
    keep_out: list[ShapeAnswer] = Field(description="Nothing of arm, tool and object enters one.")


class ObjectAnswer(BaseModel):
    """The object."""

    shape: Literal["sphere", "box", "cylinder", "capsule"]
    extent_m: Vector3 = Field(description="Its extent along its own axes [m].")
    axes_in_tool: Annotated[list[Vector3], Field(min_length=3, max_length=3)] = Field(
        description="Its axes in the tool, rows of a rotation matrix."
    )
    mass_kg: float = Field(description="[kg]")
    radius_m: float = Field(description="Of a ball; otherwise of the balls that the clearances are taken from [m].")
    drag_coefficient: float = Field(description="[-]; 0: no drag.")
    drag_per_m: float = Field(description="k of the deceleration k v² in air [1/m].")


class GripperAnswer(BaseModel):
    """How the gripper lets go."""

    delay_s: float = Field(description="From the change of its output to the object leaving [s].")
    jitter_s: float = Field(description="Standard deviation of that [s].")
    opening_direction: Vector3 | None = Field(description="Unit vector in the tool's frame; null: any.")
    opening_cone_rad: float | None = Field(description="Largest angle of the object's way out to it [rad].")
    hold_acceleration_m_s2: list[float] | None = Field(
        description="Acceleration that the grip withstands, in any direction or along x, y, z of the tool [m/s^2]."
    )


class CellModel(BaseModel):
    """A cell as the planner sees it.

    Link poses in the world: X[0] = base_in_world, X[i] = X[i-1] Rz(q_i) chain[i-1]; X[6] is the flange, and
    X[6] tool_in_flange the tool centre point.
    """

    cell: str
    sha256: str = Field(description="Hash of the cell file and its calibration.")
    robot: str = Field(description="Arm model, such as ur5e.")
    link_kind: Literal["sim", "ur"] = Field(description="`ur` is a real arm.")
    calibrated: bool = Field(description="Whether the chain is this arm's measured one.")
    sample_rate_hz: float = Field(description="Ticks of the controller [Hz].")
    joint_names: list[str]
    base_in_world: Transform = Field(description="Pose of the arm's base in the world; rows [m].")
    chain: Annotated[list[Transform], Field(min_length=6, max_length=6)] = Field(
        description="Fixed transform after the rotation of each joint, measured where the arm is calibrated; rows [m]."
    )
    a_m: Joints = Field(description="Denavit-Hartenberg a, or the distance between measured axes with its sign [m].")
    d_m: Joints = Field(description="Denavit-Hartenberg d, or the offset along the measured axis [m].")
    tool_in_flange: Transform = Field(description="Pose of the tool centre point in the flange; rows [m].")
    home: Joints = Field(description="[rad]")
    capsules: list[CapsuleAnswer] = Field(description="Of arm, tool and held object; the object is last.")
    colliding_pairs: list[Annotated[list[int], Field(min_length=2, max_length=2)]] = Field(
        description="Indices of capsules that can collide with one another."
    )
    self_clearance_m: float = Field(description="Kept between them [m].")
    limits: CellLimits
    safety: SafetyLimitsAnswer
    surroundings: SurroundingsAnswer
    object: ObjectAnswer
    gripper: GripperAnswer
    lag_s: float = Field(description="From a command to its measured motion [s].")


class SeriesAnswer(BaseModel):
    """One quantity over time."""

    name: str = Field(description="Joint, point, shape or singularity.")
    lower: float | None = Field(description="Least allowed value; null: no such limit.")
    upper: float | None = Field(description="Largest allowed value; null: no such limit.")
    values: list[float | None] = Field(description="One an instant, in the curve's unit; null where it has none.")


class CurveAnswer(BaseModel):
    """Quantities that one check of the certificate judges, with its limits."""

    name: str = Field(description="Of the certificate's check.")
    unit: str = Field(description="1 for a plain number.")
    clock: Literal["motion", "flight"] = Field(description="Which of the times its values belong to.")
    holds_until_next: bool = Field(description="Whether a value holds until the next instant: jerk.")
    limited_s: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        description="Span in which the limits hold [s]; null: everywhere."
    )
    series: list[SeriesAnswer]


class CurveTimes(BaseModel):
    """Instants of the curves, from the start of the motion."""

    motion: list[float] = Field(description="[s]")
    flight: list[float] | None = Field(description="From the release to the end of the flight; null without one [s].")


class PlanCurves(BaseModel):
    """Curves of a plan against their limits, computed by the certificate's functions at samples of the trajectory.

    The certificate proves its bounds between samples too: its value may lie a little beyond the curve.
    """

    plan_id: str
    release_time_s: float = Field(description="[s]")
    duration_s: float = Field(description="[s]")
    time_from_start: CurveTimes
    curves: list[CurveAnswer]
