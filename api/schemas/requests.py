"""Request bodies of `POST /plan` and `POST /execute`, with their examples."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from planner.request import NUMBER_MAX

UUID_PATTERN = r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"
ID_PATTERN = f"^latest$|{UUID_PATTERN}"
Number = Annotated[float, Field(ge=-NUMBER_MAX, le=NUMBER_MAX)]
Joints = Annotated[list[Number], Field(min_length=6, max_length=6)]
Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
PerJoint = Number | Joints


class RequestModel(BaseModel):
    """Base of request bodies: no unknown fields, no conversions, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class StartRequest(RequestModel):
    """Start of the launch, at rest. Give one of the two."""

    positions: Joints | None = Field(None, description="Joint positions, base to wrist 3 [rad].")
    current: Literal[True] | None = Field(
        None, description="true: the current joint positions, as the cell's executor reports them."
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> StartRequest:
        if (self.positions is None) == (self.current is None):
            raise ValueError("give either positions or current")
        return self


class Pose(RequestModel):
    """Position and orientation of the tool centre point."""

    position: Vector3 = Field(description="Position [m].")
    quaternion: Quaternion | None = Field(None, description="Orientation as a unit quaternion [x, y, z, w] [-].")
    rotation_vector: Vector3 | None = Field(
        None, description="Orientation as UR's rotation vector [rad]. Answers give both, which must agree."
    )

    @model_validator(mode="after")
    def _an_orientation(self) -> Pose:
        if self.quaternion is None and self.rotation_vector is None:
            raise ValueError("give quaternion or rotation_vector")
        return self


class Twist(RequestModel):
    """Velocity of the tool centre point."""

    linear: Vector3 = Field(description="Linear velocity [m/s].")
    angular: Vector3 = Field(description="Angular velocity [rad/s].")


class PoseReleaseRequest(RequestModel):
    """Pass a tool pose with a twist."""

    kind: Literal["pose"]
    pose: Pose = Field(description="Pose of the tool centre point at the release, in `frame`.")
    twist: Twist = Field(description="Twist of the tool centre point at the release, in `frame`.")


class PointReleaseRequest(RequestModel):
    """Pass a point with a velocity; orientation and angular velocity are free."""

    kind: Literal["point"]
    position: Vector3 = Field(description="Position of the tool centre point at the release, in `frame` [m].")
    velocity: Vector3 = Field(description="Its velocity, in `frame` [m/s].")


class JointReleaseRequest(RequestModel):
    """Pass a joint state."""

    kind: Literal["joint"]
    positions: Joints = Field(description="Joint positions at the release [rad].")
    velocities: Joints = Field(description="Joint velocities at the release [rad/s].")


class OpeningRequest(RequestModel):
    """Mouth of a round bin that is open upwards; the target is the centre of its bottom."""

    radius_m: float = Field(gt=0.0, le=10.0, description="Inner radius of the bin [m]; above the object's radius.")
    rim_height_m: float = Field(ge=0.0, le=10.0, description="Height of the rim above the target [m].")


class TargetReleaseRequest(RequestModel):
    """Hit a point by free flight; the planner chooses the release."""

    kind: Literal["target"]
    position: Vector3 = Field(description="The point to hit, in `frame` [m].")
    max_release_speed_m_s: Number | None = Field(
        None, gt=0.0, description="Maximum speed of the object at the release [m/s]."
    )
    min_elevation_rad: Number | None = Field(
        None, description="Minimum elevation of the release velocity above the horizon [rad]."
    )
    max_elevation_rad: Number | None = Field(
        None, description="Maximum elevation of the release velocity above the horizon [rad]."
    )
    min_horizontal_distance_m: Number | None = Field(
        None, ge=0.0, description="Minimum horizontal distance from the release to the target [m]."
    )
    release_position: Vector3 | None = Field(None, description="Position of the release, in `frame` [m]; absent: free.")
    opening: OpeningRequest | None = Field(
        None, description="The bin around the target: the object enters through its mouth, clear of rim and wall."
    )


ReleaseRequest = Annotated[
    PoseReleaseRequest | PointReleaseRequest | JointReleaseRequest | TargetReleaseRequest, Field(discriminator="kind")
]


class RequestLimits(RequestModel):
    """Tighter limits than the cell's; one number for all joints or one per joint."""

    velocity: PerJoint | None = Field(None, description="Joint velocity [rad/s].")
    acceleration: PerJoint | None = Field(None, description="Joint acceleration [rad/s^2].")
    jerk: PerJoint | None = Field(None, description="Joint jerk [rad/s^3].")


class PlanRequest(RequestModel):
    """A throw, or any move that must pass a state at speed."""

    cell: str | None = Field(None, description="Name of the cell; absent: the service's default cell.", max_length=64)
    start: StartRequest | None = Field(None, description="Start of the launch; absent: the cell's home.")
    release: ReleaseRequest = Field(description="The state to pass or the point to hit: one of four kinds.")
    frame: Literal["world", "base"] = Field("world", description="Frame of positions and velocities in this request.")
    backend: Literal["auto", "casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp"] = Field(
        "auto", description="Back end; auto: the best certified plan of several back ends."
    )
    limits: RequestLimits | None = Field(None, description="Limits of this plan; they may only tighten the cell's.")
    singularity_distance_min: Number | None = Field(
        None, ge=0.0, description="Minimum distance to each singularity [-]; may only tighten the cell's."
    )
    release_window_s: Number | None = Field(
        None,
        ge=0.0,
        description="A release early or late by up to this [s] still lands within `landing_tolerance_m`; without one"
        " there is no window. Absent: for a target three times the gripper's jitter, at least 0.005, otherwise 0; 0"
        " asks for the soonest release. With `min_hit_probability` it is the shortest window that is tried; absent: 0.",
    )
    landing_tolerance_m: Number | None = Field(
        None,
        ge=0.0,
        description="Maximum landing error in the release window [m]; 0: only the nominal release. Absent: for a target"
        " the room in its opening, or the object's radius, at least 0.01; for the other kinds 0.",
    )
    min_hit_probability: Number | None = Field(
        None,
        ge=0.0,
        le=1.0,
        description="Least `hit_probability` of the plan [-], for a target. With the back end `auto` a later release is"
        " planned where the soonest does not reach it: windows in steps of what is known of the release's timing, then"
        " slower throws; `infeasible` where none of them does.",
    )
    time_limit_s: Number | None = Field(
        None,
        gt=0.0,
        description="Time limit of the planner, from when it takes the request [s]; absent: 120. Where it"
        " passes before the search ends, the best motion so far can be the plan: its `solver.status` then says so.",
    )


class ExecuteRequest(RequestModel):
    """One run of one plan."""

    plan_id: str = Field(
        description="Id of the plan; `latest` is the newest one, on simulated cells only.", pattern=ID_PATTERN
    )
    mode: Literal["speedj", "servoj"] = Field("speedj", description="UR command that streams the motion.")
    dry_run: bool = Field(False, description="true: everything except motion.")
    experiment_id: str | None = Field(
        None, description="Experiment that the execution belongs to.", pattern=UUID_PATTERN
    )


_TARGET = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
_JOINT = {
    "release": {
        "kind": "joint",
        "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
        "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
    },
    "limits": {"velocity": 2.5, "jerk": 400.0},
}
_POINT = {"release": {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.6]}, "backend": "ruckig"}

_SOONEST = {**_TARGET, "release_window_s": 0.0}
_ODDS = {**_TARGET, "landing_tolerance_m": 0.1, "min_hit_probability": 0.2}
_BIN = {
    "release": {
        "kind": "target",
        "position": [1.1, -0.3, 0.0],
        "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
    }
}

PLAN_EXAMPLES = {
    "target": {"summary": "Hit a point on the floor, whenever the gripper opens", "value": _TARGET},
    "soonest": {"summary": "Hit it as soon as possible", "value": _SOONEST},
    "odds": {"summary": "Hit within 10 cm, at odds of 1 in 5 at least", "value": _ODDS},
    "bin": {"summary": "Throw into a bin", "value": _BIN},
    "joint": {"summary": "Pass a joint state, with tighter limits", "value": _JOINT},
    "point": {"summary": "Release at a point with a velocity", "value": _POINT},
}
EXECUTE_EXAMPLES = {"latest": {"summary": "Execute the newest plan (simulated cell)", "value": {"plan_id": "latest"}}}
