"""Execution responses."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.quantities import AnswerModel


class ExecutionAnswer(AnswerModel):
    """One run of one plan on one cell."""

    id: str
    plan_id: str
    cell: str
    mode: str = Field(description="speedj or servoj.")
    dry_run: bool
    requested_by: str
    created_at: str = Field(description="UTC, ISO 8601.")
    claimed_at: str | None = Field(description="When an executor claimed it.")
    finished_at: str | None
    abort_requested_at: str | None
    state: str = Field(description="queued, preparing, approaching, streaming, braking, finished.")
    outcome: str | None = Field(
        description="completed, aborted, refused, protective_stop, emergency_stop, link_lost, late, tracking, "
        "executor_lost; null before the end."
    )
    reason: str | None = Field(description="Reason of the outcome, in words.")
    metrics: dict[str, Any] | None = Field(description="Measured values; each name carries its unit.")


class ExecutionList(AnswerModel):
    """A page of executions, newest first."""

    executions: list[ExecutionAnswer]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")
