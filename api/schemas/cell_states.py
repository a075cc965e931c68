"""Documents about cells: their files, their executors, the live state of their robots."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from api.schemas.requests import Joints, RequestModel
from store import RobotAction


class ExecutorAnswer(BaseModel):
    """The executor of a cell."""

    id: str
    alive: bool = Field(description="Whether its last heartbeat is younger than two seconds.")
    heartbeat_age_s: float = Field(description="Age of its last heartbeat [s].")
    read_only: bool = Field(description="Whether it only observes and never moves the robot.")


class CellSummary(BaseModel):
    """One cell in the list."""

    name: str
    robot: str | None
    link_kind: Literal["sim", "ur"] | None = Field(description="`ur` is a real arm.")
    link_host: str | None = Field(None, description="Address of the controller.")
    default: bool
    sha256: str | None
    error: str | None = Field(description="Why the cell file is refused; null if it is valid.")
    executor: ExecutorAnswer | None = Field(description="null if the cell never had one.")


class CellList(BaseModel):
    """Every cell file of the service."""

    cells: list[CellSummary]


class RobotStateAnswer(BaseModel):
    """The live state of a robot, four times a second; what its controller does not tell is absent or null."""

    connected: bool = Field(False, description="Whether the controller sends its state.")
    refusals: list[str] = Field([], description="Why the robot would not move now, in words; empty: it would.")
    warnings: list[str] = Field([], description="What a person should know, and does not keep it from moving.")
    cell_sha256: str | None = Field(None, description="Hash of the cell file that the executor uses.")
    serial_number: str | None = Field(None, description="Of the robot, as its controller tells it.")
    polyscope: str | None = Field(None, description="Version of the controller's software.")
    timestamp_s: float | None = Field(None, description="The controller's time [s].")
    positions: Joints | None = Field(None, description="Measured joint positions [rad].")
    velocities: Joints | None = Field(None, description="Measured joint velocities [rad/s].")
    robot_mode: int | None = Field(None, description="`robot_mode` of UR's RTDE guide; 7: running.")
    safety_status_bits: int | None = Field(None, description="`safety_status_bits` of UR's RTDE guide; 1: normal.")
    runtime_state: int | None = Field(None, description="`runtime_state` of UR's RTDE guide; 2: playing.")
    speed_scaling: float | None = Field(None, description="Speed scaling times slider [-].")
    digital_output_bits: int | None = None
    digital_input_bits: int | None = None
    gripper_open: bool | None = Field(None, description="Whether its output opens the gripper; null: none does.")
    gripper_holds: bool | None = Field(None, description="What `gripper.grip_input` shows; null: the cell has none.")
    payload_kg: float | None = Field(None, description="Configured on the controller [kg].")
    tcp_offset: Joints | None = Field(None, description="Configured: position [m], rotation vector [rad].")


class FaultAnswer(BaseModel):
    """A fault after which the executor refuses to move the robot."""

    outcome: str | None = Field(None, description="Of the execution that ended with it.")
    reason: str = Field(description="In words.")
    execution_id: str | None = None
    at: float | None = Field(None, description="Seconds since the epoch [s].")


class RobotActionRequest(RequestModel):
    """What a person asks of a robot."""

    action: RobotAction = Field(
        description="`power_on`: the arm, brakes stay engaged; `brake_release`; `unlock_protective_stop`: once its "
        "cause was looked for; `power_off`."
    )


class RobotActionAnswer(BaseModel):
    """A request to operate a robot, and what became of it."""

    id: str
    action: RobotAction
    requested_by: str
    requested_at: str = Field(description="UTC, ISO 8601.")
    state: Literal["waiting", "done", "refused"] = Field(description="waiting: for the executor, or the controller.")
    text: str = Field(description="By which interface it was done, or why not; empty while it waits.")


class CellState(BaseModel):
    """The live state of a cell's robot, as its executor last reported it."""

    cell: str
    executor: ExecutorAnswer | None
    robot: RobotStateAnswer | None = Field(description="null without an executor.")
    fault: FaultAnswer | None = Field(
        description="Latched until a person acknowledges it; a refused cell file: until it is repaired."
    )
    execution_id: str | None = Field(description="The unfinished execution of the cell.")
    robot_request: RobotActionAnswer | None = Field(None, description="The newest `POST /cells/{name}/robot`.")
    not_executable: str | None = Field(
        None, description="Why `POST /execute` by this caller would be refused now; null: it would be queued."
    )


class Acknowledged(BaseModel):
    """An acknowledged fault."""

    cell: str
    acknowledged_by: str
    fault: FaultAnswer | None = Field(description="The fault that is being cleared.")


class CellChange(BaseModel):
    """One key that differs from the version before."""

    key: str = Field(description="Dotted path in the cell file, or `calibration file`.")
    before: Any = Field(description="null where the file left it out.")
    after: Any = Field(description="null where the file leaves it out.")


class CellVersion(BaseModel):
    """One version of a cell file."""

    version: int
    sha256: str
    seen_at: str = Field(description="UTC, ISO 8601.")
    seen_by: str = Field(description="service, executor or command line.")
    changes: list[CellChange]


class CellHistory(BaseModel):
    """The versions of a cell file, newest first."""

    cell: str
    versions: list[CellVersion]


ROBOT_EXAMPLES = {"power-on": {"summary": "Power the arm on", "value": {"action": "power_on"}}}
