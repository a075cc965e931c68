"""What the store answers: frozen rows. Times are seconds since the epoch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PlanRow:
    """One plan. `document` is the JSON of `POST /plan`; `summary` the same without its trajectory, alone in lists."""

    id: str
    created_at: float
    cell: str
    cell_sha256: str
    backend: str
    summary: bytes
    document: bytes = b""


@dataclass(frozen=True)
class ExecutionRow:
    """One run of one plan on one cell."""

    id: str
    plan_id: str
    cell: str
    mode: str
    dry_run: bool
    requested_by: str
    created_at: float
    abort_requested_at: float | None
    claimed_at: float | None
    executor_id: str | None
    state: str
    outcome: str | None
    reason: str | None
    metrics: Mapping[str, Any] | None
    finished_at: float | None


@dataclass(frozen=True)
class EventRow:
    """Something that happened in an execution; `kind` is "state", "telemetry" or "note"."""

    id: int
    execution_id: str
    at: float
    kind: str
    data: Mapping[str, Any]


@dataclass(frozen=True)
class RecordingRow:
    """Planned against measured, one row a tick, in two formats."""

    execution_id: str
    mcap: bytes
    csv: bytes


@dataclass(frozen=True)
class CellRow:
    """What the executor of a cell last said, and whether a person acknowledged its fault since."""

    cell: str
    executor_id: str
    heartbeat_at: float
    link_kind: str
    robot: Mapping[str, Any]
    fault: Mapping[str, Any] | None
    read_only: bool
    acknowledge_requested_at: float | None = None
    acknowledge_handled_at: float | None = None
    acknowledged_by: str | None = None


@dataclass(frozen=True)
class IdempotencyKey:
    """A client's key for a POST: who and where (`scope`), the key, and what was posted."""

    scope: str
    key: str
    body_sha256: str
