"""Documents about executions: their state, their metrics, their events."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

from api.schemas.requests import MODE_HELP, ExecutionMode, Joints, Vector3
from api.schemas.timing import TimingNumbers

ExecutionState = Literal["queued", "preparing", "approaching", "streaming", "braking", "finished"]
Outcome = Literal[
    "completed",
    "aborted",
    "refused",
    "held",
    "protective_stop",
    "emergency_stop",
    "link_lost",
    "late",
    "tracking",
    "executor_lost",
    "foreign_program",
    "power_off",
    "released_early",
    "not_released",
]


class RunTiming(TimingNumbers):
    """Timing of the arm in this run."""

    assumed_lag_s: float = Field(description="Lag that the run was streamed with [s].")
    ramp_rad_s2: float | None = Field(description="Acceleration of speedj, where it held the arm back [rad/s^2].")
    residual_rms_rad_s: float = Field(description="What the timing does not explain, rms [rad/s].")
    rows: int = Field(description="Rows of the recording.")


class SwitchedOutput(BaseModel):
    """An output of a passage in one run; times are on the plan's clock."""

    passage: str | None = Field(description="null: a stop switched it.")
    output: str
    index: int
    level: bool
    command_time_s: float | None = Field(description="When it was sent [s]; null where it was not.")
    edge_time_s: float | None = Field(
        description="When it was seen to change, up to a tick after it did [s]; null where it was not."
    )
    edge_after_s: float | None = Field(None, description="Time of the state before that: it changed in between [s].")
    sense_input: int | None = Field(None, description="Input that showed it; null: the controller's own report.")
    edge_late_s: float | None = Field(description="That less the planned edge [s].")


class GripCheck(BaseModel):
    """What was seen of the grip of a throw before the arm moved."""

    held: bool = Field(description="Whether the gripper held an object.")
    by: Literal["input", "gripper"] = Field(description="What showed it: `gripper.grip_input`, or the gripper itself.")
    opened_again: bool = Field(False, description="Whether it had closed on nothing, and was opened again.")


class FurtherRelease(BaseModel):
    """What became of an object that another gripper let go than the first; times are on the plan's clock."""

    gripper: str | None = Field(description="Its name in `[grippers]`; null: the cell's `[gripper]`.")
    passage: str
    commanded_s: float | None = Field(description="When its output was sent; null: never [s].")
    opened_s: float | None = Field(description="When the object left; simulated cells [s].")
    opened_late_s: float | None = Field(description="That less the planned release [s].")
    landing_point: Vector3 | None = Field(description="Where the object landed; simulated cells [m].")
    landing_error_m: float | None = Field(description="Distance from the planned landing point [m].")
    landed_on: str | None = Field(description="What it landed on; simulated cells.")


class ExecutionMetrics(BaseModel):
    """What was measured in one run; null where this run or this cell has no value."""

    ticks: int | None = Field(None, description="Rows of the stream.")
    missed_ticks: int | None = Field(None, description="Ticks that were lost.")
    ready_s: float | None = Field(
        None, description="From taking the execution on to an arm at the plan's start, its gripper closed [s]."
    )
    period_p50_s: float | None = Field(None, description="Median of the time between two ticks [s].")
    period_p99_s: float | None = Field(None, description="99th percentile [s].")
    period_max_s: float | None = Field(None, description="Longest [s].")
    realtime: bool | None = Field(None, description="Whether the operating system granted real-time scheduling.")
    timing: RunTiming | None = Field(None, description="What the run shows of the arm's timing.")
    tracking_error_max_rad: float | None = Field(None, description="Largest joint error against the plan [rad].")
    tracking_error_max_m: float | None = Field(None, description="Largest error of the tool centre point [m].")
    path_error_max_m: float | None = Field(None, description="Largest distance from the planned path [m].")
    release_velocity_error_rad_s: float | None = Field(None, description="Of a joint at the release [rad/s].")
    release_velocity_error_share: float | None = Field(
        None, description="The same as a share of the fastest planned joint speed [-]."
    )
    release_velocity_unexpected_rad_s: float | None = Field(
        None, description="The same beyond what the plan's profile expects, by three standard deviations [rad/s]."
    )
    gripper_commanded_s: float | None = Field(None, description="When the output was sent, on the plan's clock [s].")
    gripper_command_late_s: float | None = Field(None, description="How late that was [s].")
    gripper_moved_s: list[float] | None = Field(
        None, description="Between which times its fingers began to open, by its own reports [s]."
    )
    gripper_opened_s: float | None = Field(None, description="When the object left; simulated cells [s].")
    gripper_opened_late_s: float | None = Field(None, description="That less the planned release [s].")
    grip: GripCheck | None = Field(None, description="null: nothing in this cell shows it, or nothing is let go.")
    released: bool | None = Field(None, description="Whether the gripper was commanded to open.")
    object_left: bool | None = Field(None, description="Whether an object was then seen to leave; simulated cells.")
    outputs: list[SwitchedOutput] = Field([], description="Of the passages, in the order of their commands.")
    landing_point: Vector3 | None = Field(None, description="Where the object landed; simulated cells [m].")
    landing_error_m: float | None = Field(
        None, description="Distance from the planned landing point, as a target that moves carries it [m]."
    )
    landed_on: str | None = Field(None, description="What the object landed on; simulated cells.")
    grippers: list[FurtherRelease] | None = Field(
        None, description="Of a motion in which several grippers let go: all but the first, whose is the above."
    )


class ReplacementAnswer(BaseModel):
    """What became of a request to go on with another plan."""

    id: str
    plan_id: str
    joins_s: float | None = Field(
        description="When that plan begins, on the execution's clock [s]; null: refused, the running plan went on."
    )
    reason: str = Field(description="Why it was refused; empty where it was not.")


class ExecutionAnswer(BaseModel):
    """One run of one plan on one cell."""

    id: str
    plan_id: str
    cell: str
    mode: ExecutionMode = Field(description=MODE_HELP)
    dry_run: bool
    requested_by: str
    created_at: str = Field(description="UTC, ISO 8601.")
    claimed_at: str | None = Field(description="When an executor claimed it.")
    finished_at: str | None
    abort_requested_at: str | None
    state: ExecutionState
    outcome: Outcome | None = Field(description="null before the end.")
    reason: str | None = Field(description="Reason of the outcome, in words.")
    metrics: ExecutionMetrics | None = Field(
        description="null where the run was refused before it began, or its executor lost."
    )
    experiment_id: str | None = Field(None, description="Experiment that it belongs to.")
    request_id: str | None = Field(None, description="`X-Request-ID` of the request that queued it.")
    replacements: list[ReplacementAnswer] = Field(
        description="The plans that were to replace the running one, in their order."
    )
    executor_lost: bool = Field(
        description="Whether it is unfinished and its executor does not report: nobody carries it, nobody can brake. "
        "An executor that starts again ends it with the outcome `executor_lost`."
    )


class ExecutionList(BaseModel):
    """A page of executions, newest first."""

    executions: list[ExecutionAnswer]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


class StateEvent(BaseModel):
    """Event `state`: the execution has come to a state; with the last one its outcome."""

    at: str = Field(description="UTC, ISO 8601.")
    state: ExecutionState
    outcome: Outcome | None = None
    reason: str | None = None
    metrics: ExecutionMetrics | None = None


class TargetEvent(BaseModel):
    """Event `target`: what an observation of a tracked target means for the throw at it."""

    at: str = Field(description="UTC, ISO 8601.")
    target: str = Field(description="Id of the target.")
    observed_at_s: float = Field(description="Time of the observation, on the controller's clock [s].")
    miss_m: float = Field(description="From where the plan meets the target to where it is expected then [m].")
    room_m: float = Field(description="Distance from the target that counts as a hit [m].")
    hit_probability: float = Field(description="As it is now [-].")
    stopped: bool = Field(description="Whether the throw was stopped for it.")


class TelemetryEvent(BaseModel):
    """Event `telemetry`: the arm at one instant, planned and measured, 20 times a second or more."""

    at: str = Field(description="UTC, ISO 8601.")
    clock_s: float = Field(description="On the plan's clock; negative during the approach [s].")
    positions: Joints = Field(description="Measured [rad].")
    velocities: Joints = Field(description="Measured [rad/s].")
    planned_positions: Joints = Field(description="[rad]")
    planned_velocities: Joints = Field(description="[rad/s]")
    missed_ticks: int = Field(description="So far.")
