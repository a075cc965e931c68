"""Plan responses."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.quantities import AnswerModel, Joints, Quaternion, Vector3


class FullPose(AnswerModel):
    """Pose of the tool centre point in the world."""

    position: Vector3 = Field(description="Position [m].")
    quaternion: Quaternion = Field(description="Orientation [x, y, z, w] [-].")
    rotation_vector: Vector3 = Field(description="The same orientation as a rotation vector [rad].")


class FullTwist(AnswerModel):
    """Twist of the tool centre point in the world."""

    linear: Vector3 = Field(description="[m/s]")
    angular: Vector3 = Field(description="[rad/s]")


class ReleaseState(AnswerModel):
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


class WindowEntry(AnswerModel):
    """Landing error of an early or late release."""

    delay_s: float = Field(description="Delay of the release [s]; negative is early.")
    landing_error_m: float | None = Field(description="Distance from the nominal landing point [m].")


class FlightAnswer(AnswerModel):
    """The object's path after the release."""

    landing_point: Vector3 = Field(description="In the world [m].")
    time_of_flight_s: float = Field(description="[s]")
    apex_height_m: float = Field(description="Highest point of the flight, in the world [m].")
    speed_m_s: float = Field(description="Speed at the release [m/s].")
    landing_per_release_delay_m_s: Vector3 | None = Field(
        description="Shift of the landing point per delay of the release [m/s]."
    )
    window: list[WindowEntry]


class TrajectoryAnswer(AnswerModel):
    """Samples at i / sample_rate_hz with the field names of ROS JointTrajectory; the last one is at rest."""

    joint_names: list[str]
    time_from_start: list[float] = Field(description="[s]")
    positions: list[Joints] = Field(description="[rad]")
    velocities: list[Joints] = Field(description="[rad/s]")
    accelerations: list[Joints] = Field(description="[rad/s^2]")


class CheckAnswer(AnswerModel):
    """One check of the certificate."""

    name: str
    value: float | None = Field(description="Worst value, in `unit`.")
    limit: float | None = Field(description="Its limit, in `unit`.")
    unit: str
    margin: float | None = Field(description="Distance of the value from the limit, in `unit`.")
    at_s: float | None = Field(description="Time on the trajectory [s].")
    ok: bool


class CertificateAnswer(AnswerModel):
    """Checks of the trajectory, made without knowing which back end found it."""

    valid: bool
    checks: list[CheckAnswer]


class SolverAnswer(AnswerModel):
    """How the plan was found."""

    solve_time_s: float = Field(description="[s]")
    iterations: int
    status: str
    attempts: list[dict[str, Any]] = Field(description="Every attempt: backend, result, duration_s [s].")


class PlanSummary(AnswerModel):
    """A plan without its trajectory."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    cell: str
    cell_sha256: str = Field(description="Hash of the cell file at the time of planning.")
    request: dict[str, Any] = Field(description="The request.")
    backend: str = Field(description="Back end that found the plan.")
    sample_rate_hz: float = Field(description="[Hz]")
    duration_s: float = Field(description="[s]")
    release_time_s: float = Field(description="[s]")
    release: ReleaseState
    flight: FlightAnswer | None = Field(description="null for a move that ends at rest.")
    certificate: CertificateAnswer
    solver: SolverAnswer


class PlanAnswer(PlanSummary):
    """A plan: request, trajectory, certificate. Immutable."""

    trajectory: TrajectoryAnswer | None = Field(None, description="Left out by `?trajectory=false`.")


class PlanList(AnswerModel):
    """A page of plans, newest first."""

    plans: list[PlanSummary]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")
