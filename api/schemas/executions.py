"""Executions, cells, health as they are answered."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.quantities import Answer


class ExecutionAnswer(Answer):
    """One run of one plan on one cell."""

    id: str
    plan_id: str
    cell: str
    mode: str = Field(description="speedj or servoj.")
    dry_run: bool
    requested_by: str
    created_at: str = Field(description="UTC, ISO 8601.")
    claimed_at: str | None = Field(description="When an executor took it.")
    finished_at: str | None
    abort_requested_at: str | None
    state: str = Field(description="queued, preparing, approaching, streaming, braking, finished.")
    outcome: str | None = Field(
        description="completed, aborted, refused, protective_stop, emergency_stop, link_lost, late, tracking, "
        "executor_lost; null before the end."
    )
    reason: str | None = Field(description="Why it ended so, in words.")
    metrics: dict[str, Any] | None = Field(description="Measured figures; each name carries its unit.")


class ExecutionList(Answer):
    """A page of executions, newest first."""

    executions: list[ExecutionAnswer]
    next_cursor: str | None


class ExecutorAnswer(Answer):
    """The executor of a cell."""

    id: str
    alive: bool = Field(description="Whether it was heard of within two seconds.")
    heartbeat_age_s: float = Field(description="[s]")
    read_only: bool


class CellSummary(Answer):
    """One cell in the list."""

    name: str
    robot: str | None
    link_kind: str | None = Field(description="sim or ur.")
    default: bool
    sha256: str | None
    error: str | None = Field(description="Why the cell file is refused; null where it is not.")
    executor: ExecutorAnswer | None = Field(description="null where none ever spoke.")


class CellList(Answer):
    """Every cell file of the service."""

    cells: list[CellSummary]


class CellState(Answer):
    """The live state of a cell's robot, as its executor last told."""

    cell: str
    executor: ExecutorAnswer | None
    robot: dict[str, Any] | None = Field(description="Mode, safety, joint positions [rad]; null without an executor.")
    fault: dict[str, Any] | None = Field(description="Latched until a person acknowledges it.")
    execution_id: str | None = Field(description="The execution that is not finished.")


class Acknowledged(Answer):
    """A person has looked."""

    cell: str
    acknowledged_by: str
    fault: dict[str, Any] | None = Field(description="The fault that is being cleared.")


class Readiness(Answer):
    """Whether the service can plan and reach its store, and which cells have an executor."""

    ready: bool
    store: bool
    planner: bool
    cells: dict[str, bool] = Field(description="Whether each cell has an executor.")


class FieldReason(Answer):
    """One refused field."""

    field: str
    reason: str


class ProblemAnswer(Answer):
    """An error (RFC 9457)."""

    type: str = Field(description="/problems/<name>, a page that explains it.")
    title: str
    status: int
    detail: str
    instance: str
    errors: list[FieldReason] | None = Field(None, description="invalid-request: every refused field.")
    violations: list[dict[str, Any]] | None = Field(None, description="infeasible: constraint, value, limit, unit.")
    nearest: dict[str, Any] | None = Field(None, description="infeasible: the closest request that can be done.")
