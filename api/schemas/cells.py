"""Responses about cells, their executors and the readiness of the service."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.quantities import AnswerModel


class ExecutorAnswer(AnswerModel):
    """The executor of a cell."""

    id: str
    alive: bool = Field(description="Whether its last heartbeat is younger than two seconds.")
    heartbeat_age_s: float = Field(description="Age of its last heartbeat [s].")
    read_only: bool = Field(description="Whether it only observes and never moves the robot.")


class CellSummary(AnswerModel):
    """One cell in the list."""

    name: str
    robot: str | None
    link_kind: str | None = Field(description="sim or ur.")
    default: bool
    sha256: str | None
    error: str | None = Field(description="Why the cell file is refused; null if it is valid.")
    executor: ExecutorAnswer | None = Field(description="null if the cell never had one.")


class CellList(AnswerModel):
    """Every cell file of the service."""

    cells: list[CellSummary]


class CellState(AnswerModel):
    """The live state of a cell's robot, as its executor last reported it."""

    cell: str
    executor: ExecutorAnswer | None
    robot: dict[str, Any] | None = Field(description="Mode, safety, joint positions [rad]; null without an executor.")
    fault: dict[str, Any] | None = Field(description="Latched until a person acknowledges it.")
    execution_id: str | None = Field(description="The unfinished execution of the cell.")


class Acknowledged(AnswerModel):
    """An acknowledged fault."""

    cell: str
    acknowledged_by: str
    fault: dict[str, Any] | None = Field(description="The fault that is being cleared.")


class Readiness(AnswerModel):
    """Whether the service can plan and reach its store, and which cells have an executor."""

    ready: bool
    store: bool
    planner: bool
    cells: dict[str, bool] = Field(description="Whether each cell has an executor.")
