"""Documents about profiles: what was learnt of a cell."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from api.schemas.timing import PerJoint, PooledTimingAnswer


class ExplainedLanding(BaseModel):
    """One throw behind a profile: where it was to land, where it did, where the profile expects it."""

    execution_id: str
    planned: list[float] = Field(description="Target, or where the plan's flight ends: x, y [m].")
    observed: list[float] = Field(description="[m]")
    expected: list[float] = Field(description="By the profile that this throw was one of [m].")


class UnusedThrowAnswer(BaseModel):
    """A throw with a reported landing that the profile does not rest on."""

    execution_id: str
    reason: str


class ProfileEvidence(BaseModel):
    """What a profile rests on, by id."""

    throws: list[str] = Field(description="Executions whose landing counts.")
    landings: list[str] = Field(description="The observations of them.")
    reported: list[str] = Field([], description="Executions whose gripper reported when its fingers began to open.")
    recordings: list[str] = Field(description="Executions whose joint speeds count.")
    timing: list[str] = Field(description="Executions that show the arm's timing.")
    not_used: list[UnusedThrowAnswer] = Field(
        [], description="Throws with a landing that does not count, oldest first."
    )
    doubted: list[UnusedThrowAnswer] = Field(
        [], description="Throws whose landing is most likely a mistaken report, which weighs it lightly; oldest first."
    )


class LearntOutput(BaseModel):
    """Delay of one of the cell's outputs, as the input that is wired to it shows it."""

    delay_s: float = Field(description="From one lag after the command to the edge: its mean [s].")
    delay_std_s: float = Field(description="Standard error of that [s].")
    jitter_s: float = Field(description="Standard deviation of the delay [s].")
    jitter_std_s: float = Field(description="Standard error of that [s].")
    edges: int = Field(description="How many were seen.")


class ProfileSummary(BaseModel):
    """What was learnt of a cell at one time. Immutable."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    created_by: str
    cell: str
    cell_sha256: str = Field(description="Hash of the cell file that it was learnt with.")
    cell_version: int | None = Field(None, description="Version of the cell file that it was learnt with.")
    sha256: str = Field(description="Hash of the profile's document.")
    adopted: bool = Field(description="Whether the cell uses it now.")
    lag_s: float = Field(description="[s]")
    lag_std_s: float | None = Field(description="null where no run shows it [s].")
    gain: PerJoint | None = Field(description="Measured over commanded velocity of each joint [-].")
    delay_s: float = Field(description="From the change of the gripper's output to the object leaving [s].")
    delay_std_s: float = Field(description="[s]")
    jitter_s: float = Field(description="Standard deviation of the opening [s].")
    jitter_std_s: float = Field(description="[s]")
    speed_factor: float = Field(description="The object's speed over the tool's at the release [-].")
    speed_factor_std: float = Field(description="[-]")
    outputs: dict[str, LearntOutput] = Field({}, description="Of the cell's outputs that an input sees, by name.")
    landing_offset_m: list[float] = Field(description="Shift of the base, and with it of every landing: x, y [m].")
    landing_offset_std_m: list[float] = Field(description="[m]")
    drag_coefficient: float = Field(description="The cell file's where throws do not show it [-].")
    drag_coefficient_std: float = Field(description="[-]")
    base_turn_rad: float = Field(description="Rotation of the base about the vertical [rad].")
    base_turn_std_rad: float = Field(description="[rad]")
    cling_share: float = Field(description="Share of throws in which the object leaves slower [-].")
    landing_error_before_m: float | None = Field(
        None, description="Median distance of the observed landings from where they were to be [m]."
    )
    landing_error_after_m: float | None = Field(
        None, description="The same from where the profile expects them, which has seen them [m]."
    )
    evidence: ProfileEvidence


class ProfileAnswer(ProfileSummary):
    """A profile with its posterior."""

    state: list[str] = Field(description="Names of the covariance's rows; `lead_s` is lag and delay together.")
    covariance: list[list[float]] = Field(description="Of `state`; names that end in `_s` are times [s].")
    mixture: dict[str, Any] = Field(description="The posterior: Gaussians over the state, a point of jitter each.")
    joint_speeds: dict[str, Any] = Field(description="Gain errors and scatter of the joints at the release.")
    timing: PooledTimingAnswer | None = Field(description="Of the arm, pooled over runs; null where no run shows it.")
    landings: list[ExplainedLanding] = Field([], description="Throws whose landing was observed, oldest first.")
    cell_file: dict[str, float] = Field(description="The numbers that the cell file gives [s].")


class ProfileList(BaseModel):
    """Profiles of a cell, newest first."""

    cell: str
    adopted: str | None = Field(description="Id of the profile that the cell uses; null: the cell file's numbers.")
    warning: str | None = Field(None, description="Why the profile that was adopted is not used, where it is not.")
    profiles: list[ProfileSummary]


class CalibrationMoves(BaseModel):
    """What a calibration moves: requests, ready to be posted to `/plan`."""

    cell: str
    amplitude_rad: float = Field(description="A joint moves this far in a small motion, at most [rad].")
    motions: list[list[dict[str, Any]]] = Field(
        description="Small motions about home, without an object: for each the requests, the longest motion first. "
        "The first that is feasible is the one."
    )
    outputs: list[dict[str, Any]] = Field(
        description="Motions about home that switch every output with a `sense_input` eight times, without an object: "
        "the longest first. The first that is feasible is the one; none without such an output."
    )
    reach_m: list[float] = Field(description="The targets' least and largest distance from the arm's base [m].")
    throws: list[dict[str, Any]] = Field(
        description="Soonest throws to targets on the floor, no two alike, several for each that is wanted: those that "
        "are refused are left out."
    )


class Adoption(BaseModel):
    """What a cell uses from now on."""

    cell: str
    profile: str | None = Field(description="null: the cell file's numbers.")
    adopted_by: str
