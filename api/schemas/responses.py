"""Response bodies. They document the responses; the JSON itself comes from planner and store."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, Literal

from pydantic import BaseModel, Field

from api.schemas.requests import Joints, Quaternion, Vector3


class FullPose(BaseModel):
    """Pose of the tool centre point in the world."""

    position: Vector3 = Field(description="Position [m].")
    quaternion: Quaternion = Field(description="Orientation [x, y, z, w] [-].")
    rotation_vector: Vector3 = Field(description="The same orientation as a rotation vector [rad].")


class FullTwist(BaseModel):
    """Twist of the tool centre point in the world."""

    linear: Vector3 = Field(description="[m/s]")
    angular: Vector3 = Field(description="[rad/s]")


class ReleaseState(BaseModel):
    """The state in which the object leaves the tool."""

    index: int = Field(description="Sample of the trajectory; the release is exactly on a tick.")
    positions: Joints = Field(description="[rad]")
    velocities: Joints = Field(description="[rad/s]")
    accelerations: Joints = Field(description="[rad/s^2]")
    pose: FullPose
    twist: FullTwist
    command_time_s: float | None = Field(
        description="Time of the gripper's open command: release - gripper delay - arm lag [s]; null at rest."
    )


class OutputTimes(BaseModel):
    """An output that switches about a passage; times are on the plan's clock."""

    output: str
    index: int
    level: bool
    offset_s: float = Field(description="As in the request [s].")
    offset_m: float | None = Field(None, description="As in the request [m]; absent without a line.")
    command_time_s: float = Field(description="When it is commanded: edge - delay of the output - arm lag [s].")
    edge_time_s: float = Field(description="When it changes [s].")


class WindowEntry(BaseModel):
    """Landing error of an early or late release."""

    delay_s: float = Field(description="Delay of the release [s]; negative is early.")
    landing_error_m: float | None = Field(description="Distance from the nominal landing point [m].")


class LandingShift(BaseModel):
    """Shift of the landing point [m] for a release 10 ms early and late; null where the object never lands."""

    early: float | None = Field(description="[m]")
    late: float | None = Field(description="[m]")


class LandingOrientation(BaseModel):
    """How an object that is no ball lies as it first touches what it lands on, in the world."""

    quaternion: Quaternion = Field(description="Of its axes [x, y, z, w] [-].")
    rotation_vector: Vector3 = Field(description="The same as a rotation vector [rad].")
    axis: Vector3 = Field(description="Its z axis, a unit vector.")


class FlightAnswer(BaseModel):
    """The object's path after the release."""

    landing_point: Vector3 = Field(description="In the world [m].")
    landing_orientation: LandingOrientation | None = Field(None, description="Null of a ball.")
    time_of_flight_s: float = Field(description="[s]")
    apex_height_m: float = Field(description="Highest point of the flight, in the world [m].")
    speed_m_s: float = Field(description="The object's speed as it leaves [m/s]: the tool's, times the factor.")
    release_speed_factor: float = Field(1.0, description="The object's speed over the tool's as it leaves [-].")
    drag_coefficient: float | None = Field(None, description="Of the object [-]; absent from plans of version 0.1.")
    drag_per_m: float | None = Field(None, description="k of the deceleration k v² in air [1/m]; as above.")
    landing_per_release_delay_m_s: Vector3 | None = Field(
        description="Shift of the landing point per delay of the release [m/s]."
    )
    landing_shift_10ms_m: LandingShift
    object_path: list[Vector3] = Field(description="Positions every 20 ms from the release to the landing [m].")
    release_window_s: float = Field(description="Half width of the release window; 0: only the nominal release [s].")
    landing_tolerance_m: float = Field(description="Landing error allowed in the window [m].")
    window: list[WindowEntry]


class PassageAnswer(ReleaseState):
    """A state that the motion passes, or that at a line's start; `command_time_s` is null where nothing is let go."""

    name: str
    end_index: int = Field(description="Sample at which the passage ends: that of a line's end; of a state, `index`.")
    time_s: float = Field(description="[s]")
    releases: bool | str = Field(
        description="Whether an object leaves the tool here; of one of `[grippers]`, its name."
    )
    flight: FlightAnswer | None = Field(
        None, description="Of the object that leaves here; absent for a cell without `[grippers]`."
    )
    outputs: list[OutputTimes]


class TrajectoryAnswer(BaseModel):
    """Samples at i / sample_rate_hz with the field names of ROS JointTrajectory; the last one is at rest."""

    joint_names: list[str]
    time_from_start: list[float] = Field(description="[s]")
    positions: list[Joints] = Field(description="[rad]")
    velocities: list[Joints] = Field(description="[rad/s]")
    accelerations: list[Joints] = Field(description="[rad/s^2]")


class CheckAnswer(BaseModel):
    """One check of the certificate."""

    name: str
    value: float | None = Field(description="Worst value, in `unit`.")
    limit: float | None = Field(description="Its limit, in `unit`.")
    unit: str
    margin: float | None = Field(description="Distance of the value from the limit, in `unit`.")
    at_s: float | None = Field(description="Time on the trajectory [s].")
    ok: bool


class CertificateAnswer(BaseModel):
    """Checks of the trajectory, made without knowing which back end found it."""

    valid: bool
    checks: list[CheckAnswer]
    not_checked: list[str] = Field(
        description="Checks and quantities that stay unverified: the cell gives no limit, or the model cannot tell."
    )


class SolverAnswer(BaseModel):
    """How the plan was found."""

    solve_time_s: float = Field(description="[s]")
    iterations: int
    status: str = Field(
        description="Final status of the back end, in words; ends in 'time_limit ended the search' where "
        "`time_limit_s` passed before the search was done: with more time the release may be sooner, or the aim better."
    )
    attempts: list[dict[str, Any]] = Field(
        description="Of the searches that found a motion: backend, result, duration_s [s]."
    )


class WayHomeAnswer(BaseModel):
    """A certified motion from the plan's end to the cell's home, at the pace of an approach."""

    duration_s: float = Field(description="[s]; 0 where the plan ends at home.")


class HitProbability(BaseModel):
    """How likely the object lands within the opening, or else within the landing tolerance or the object's radius."""

    value: float = Field(description="Probability of a hit [-].")
    interval: list[float] = Field(description="90 % interval of this cell's own probability [-].")
    profile: str | None = Field(description="Profile that it rests on; null: the cell file and wide priors.")
    radius_m: float = Field(description="Distance from the target that counts as a hit [m].")


class LandingEllipse(BaseModel):
    """Where the object is expected to land."""

    center: list[float] = Field(description="Median landing point, x and y [m].")
    covariance_m2: list[list[float]] = Field(description="Covariance of x and y [m^2].")


class AimAnswer(BaseModel):
    """Where the plan aims, so that the learnt cell hits the target."""

    position: list[float] = Field(description="[m]")
    shift_m: list[float] = Field(description="Aim less target [m].")


class PlanContent(BaseModel):
    """What every plan says, stored or not."""

    created_at: str = Field(description="UTC, ISO 8601.")
    cell: str
    cell_sha256: str = Field(description="Hash of the cell file at the time of planning.")
    request: dict[str, Any] = Field(description="The request.")
    backend: str = Field(description="Back end that found the plan.")
    sample_rate_hz: float = Field(description="[Hz]")
    duration_s: float = Field(description="[s]")
    starts_at_s: float | None = Field(
        None, description="When it must start, on the controller's clock [s]; only where its target moves."
    )
    release_time_s: float | None = Field(description="[s]; null for passages that let nothing go.")
    release: ReleaseState | None = Field(description="null for passages that let nothing go.")
    passages: list[PassageAnswer] | None = Field(None, description="Absent where a release alone was asked for.")
    flight: FlightAnswer | None = Field(description="null for a motion that throws nothing.")
    way_home: WayHomeAnswer | None = Field(None, description="Plans of earlier versions have none.")
    certificate: CertificateAnswer
    solver: SolverAnswer
    request_id: str | None = Field(None, description="`X-Request-ID` of the request that made it.")
    cell_version: int | None = Field(None, description="Version of the cell file, as GET /cells/{name}/history counts.")
    profile: str | None = Field(None, description="The profile that was used; null: the cell file's numbers.")
    aim: AimAnswer | None = Field(None, description="null where the plan aims at the target itself.")
    hit_probability: HitProbability | None = Field(None, description="For a target.")
    landing_ellipse: LandingEllipse | None = Field(None, description="For a target.")


class PlanSummary(PlanContent):
    """A plan without its trajectory."""

    id: str


class PlanPreview(PlanContent):
    """A plan that is not stored and cannot be executed."""

    trajectory: TrajectoryAnswer | None = Field(None, description="Left out by `?trajectory=false`.")


class PlanAnswer(PlanSummary):
    """A plan: request, trajectory, certificate. Immutable."""

    trajectory: TrajectoryAnswer | None = Field(None, description="Left out by `?trajectory=false`.")


class PlanProgress(BaseModel):
    """Event `progress`: what the search for a plan has come to."""

    stage: Literal["queued", "search", "nearest"] = Field(
        description="In line; searching for what was asked; for something near it, after that was refused."
    )
    candidates: int = Field(description="Release states tried so far.")
    best_release_time_s: float | None = Field(description="Soonest certified release so far [s]; null without any.")
    elapsed_s: float = Field(description="Since the request [s].")


class PlanList(BaseModel):
    """A page of plans, newest first."""

    plans: list[PlanSummary]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


class Readiness(BaseModel):
    """Whether the service can plan and reach its store, and which cells have an executor."""

    ready: bool
    store: bool
    planner: bool
    cells: dict[str, bool] = Field(description="Whether each cell has an executor.")


class Health(BaseModel):
    """The service lives."""

    status: Literal["ok"]
    version: str = Field(description="Of Fling.")


def iso_time(at: float | None) -> str | None:
    """Returns seconds since the epoch as UTC in ISO 8601 with milliseconds; None stays None."""
    if at is None:
        return None
    return datetime.fromtimestamp(at, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
