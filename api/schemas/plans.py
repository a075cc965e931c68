"""A plan as it is answered."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.quantities import Answer, Joints, Quaternion, Vector3


class FullPose(Answer):
    """Pose of the tool centre point in the world."""

    position: Vector3 = Field(description="Position [m].")
    quaternion: Quaternion = Field(description="Orientation [x, y, z, w] [-].")
    rotation_vector: Vector3 = Field(description="The same orientation as a rotation vector [rad].")


class FullTwist(Answer):
    """Twist of the tool centre point in the world."""

    linear: Vector3 = Field(description="[m/s]")
    angular: Vector3 = Field(description="[rad/s]")


class ReleaseState(Answer):
    """The state in which the object leaves the tool."""

    index: int = Field(description="Sample of the trajectory; the release is exactly on a tick.")
    positions: Joints = Field(description="[rad]")
    velocities: Joints = Field(description="[rad/s]")
    accelerations: Joints = Field(description="[rad/s^2]")
    pose: FullPose
    twist: FullTwist
    command_time_s: float | None = Field(
        description="When the gripper is told to open: release - gripper delay - arm lag [s]; null at rest."
    )


class WindowEntry(Answer):
    """Where a late or early release lands."""

    delay_s: float = Field(description="Delay of the release [s], negative: early.")
    landing_error_m: float | None = Field(description="Distance from the nominal landing point [m].")


class Flight(Answer):
    """The object's path after the release."""

    landing_point: Vector3 = Field(description="In the world [m].")
    time_of_flight_s: float = Field(description="[s]")
    apex_height_m: float = Field(description="Highest point of the flight, in the world [m].")
    speed_m_s: float = Field(description="Speed at the release [m/s].")
    landing_per_release_delay_m_s: Vector3 | None = Field(description="How the landing moves with the release [m/s].")
    window: list[WindowEntry]


class TrajectoryAnswer(Answer):
    """Samples at i / sample_rate_hz, in the field names of ROS JointTrajectory; the last one is at rest."""

    joint_names: list[str]
    time_from_start: list[float] = Field(description="[s]")
    positions: list[Joints] = Field(description="[rad]")
    velocities: list[Joints] = Field(description="[rad/s]")
    accelerations: list[Joints] = Field(description="[rad/s^2]")


class CheckAnswer(Answer):
    """One judgement of the certificate."""

    name: str
    value: float | None = Field(description="Worst value found, in `unit`.")
    limit: float | None = Field(description="Its limit, in `unit`.")
    unit: str
    margin: float | None = Field(description="How far the value keeps from the limit, in `unit`.")
    at_s: float | None = Field(description="When on the trajectory [s].")
    ok: bool


class CertificateAnswer(Answer):
    """An independent judgement of the trajectory."""

    valid: bool
    checks: list[CheckAnswer]


class SolverAnswer(Answer):
    """How the answer was found."""

    solve_time_s: float = Field(description="[s]")
    iterations: int
    status: str
    attempts: list[dict[str, Any]] = Field(description="Every back end tried: backend, result, duration_s [s].")


class PlanSummary(Answer):
    """A plan without its trajectory."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    cell: str
    cell_sha256: str = Field(description="Of the cell file when it was planned.")
    request: dict[str, Any] = Field(description="What was asked.")
    backend: str = Field(description="Whose answer this is.")
    sample_rate_hz: float = Field(description="[Hz]")
    duration_s: float = Field(description="[s]")
    release_time_s: float = Field(description="[s]")
    release: ReleaseState
    flight: Flight | None = Field(description="null for a move that ends at rest.")
    certificate: CertificateAnswer
    solver: SolverAnswer


class PlanAnswer(PlanSummary):
    """A plan: request, trajectory, certificate. Never changed after it was made."""

    trajectory: TrajectoryAnswer | None = Field(None, description="Left out by `?trajectory=false`.")


class PlanList(Answer):
    """A page of plans, newest first."""

    plans: list[PlanSummary]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null: no more.")
