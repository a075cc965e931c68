"""The tables as queries name them: a column for each field of their rows, of the type that the field has.

`store/migrations.py` makes them, with keys, references and indices; a test compares the two. A comment names the writer
of each table, or of a column where a table has two: `api` is the service, `executor` the executor daemon of the cell,
`the driver` the process that plans a batch. Of an execution that no executor claimed, api may also write the aborted
result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from sqlalchemy import JSON, BigInteger, Boolean, Column, Double, LargeBinary, MetaData, Table, Text

from store.rows import (
    BatchResultRow,
    BatchRow,
    CellRow,
    CellVersionRow,
    EventRow,
    ExecutionRow,
    ExperimentRow,
    JobCycleRow,
    JobRow,
    LandingCellRow,
    LandingRow,
    MapRow,
    PlanRow,
    ProfileRow,
    RecordingRow,
    TrackedTargetRow,
)

METADATA = MetaData()
TYPES: dict[Any, Any] = {
    str: Text(),
    float: Double(),
    int: BigInteger(),
    bool: Boolean(),
    bytes: LargeBinary(),
    Mapping: JSON(none_as_null=True),
    Sequence: JSON(none_as_null=True),
}


def _columns(hints: Mapping[str, Any]) -> list[Column[Any]]:
    """Returns a column for each name with a type."""
    return [_column(name, hint) for name, hint in hints.items()]


def _column(name: str, hint: Any) -> Column[Any]:
    """Returns the column of a type, nullable where that is `… | None`."""
    kinds = get_args(hint) if get_origin(hint) is UnionType else (hint,)
    (kind,) = (kind for kind in kinds if kind is not NoneType)
    return Column(name, TYPES[get_origin(kind) or kind], nullable=NoneType in kinds)


def _table(name: str, row: type, **renamed: str) -> Table:
    """Returns the table of a row's class; `renamed` are columns that have another name than their field."""
    hints = {renamed.get(field, field): hint for field, hint in get_type_hints(row).items()}
    return Table(name, METADATA, *_columns(hints))


plans = _table("plans", PlanRow, earlier_document="document")  # written by api, never changed
experiments = _table("experiments", ExperimentRow)  # written by api, never changed

# api: id, plan_id, cell, mode, dry_run, requested_by, created_at, experiment_id, request_id, abort_requested_at,
# replace_request; it inserts the state 'queued'. executor: all others. An index allows one unfinished execution a cell.
executions = _table("executions", ExecutionRow)
# Append only, by executor; the first event of an execution, and what becomes of its target, by api.
events = _table("events", EventRow)
recordings = _table("recordings", RecordingRow, earlier_csv="csv")  # written by executor
landings = _table("landings", LandingRow)  # written by api; by executor for a simulated camera; withdrawn_* by api

targets = _table("targets", TrackedTargetRow)  # written by api

# api: acknowledge_requested_at, acknowledged_by, robot_request. executor: all others.
cells = _table("cells", CellRow)
cell_versions = _table("cell_versions", CellVersionRow)  # append only: api or executor, whoever sees a version first

profiles = _table("profiles", ProfileRow)  # written by api, never changed
adoptions = Table(  # written by api, append only; a cell's newest line is what it uses, null the cell file's numbers
    "adoptions",
    METADATA,
    *_columns({"id": int, "at": float, "cell": str, "profile_id": str | None, "adopted_by": str}),
)

# api: id, created_at, created_by, request_id, driven_by, specification, total, cancel_requested_at; it inserts the
# state 'queued', and finishes what nobody drives. The driver: all others.
batches = _table("batches", BatchRow)
batch_results = _table("batch_results", BatchResultRow)  # written by the driver of the batch, append only
maps = _table("maps", MapRow)  # written by whoever makes the map; cancel_requested_at by api
landing_cells = _table("landing_cells", LandingCellRow)  # written by whoever makes the map

# api: id, created_at, created_by, request_id, cell, total, ordered, pause_requested_at, cancel_requested_at,
# resumed_at; it inserts the state 'queued', puts a stopped job back to it, and finishes what no driver has begun. The
# driver: all others; both count `revision` up.
jobs = _table("jobs", JobRow)
job_cycles = _table("job_cycles", JobCycleRow)  # written by the driver of the job

idempotency = Table(  # written by api
    "idempotency",
    METADATA,
    *_columns({"scope": str, "key": str, "body_sha256": str, "resource_id": str, "created_at": float}),
)
audit = Table(  # written by api, append only; a null outcome is "done", by an earlier version
    "audit",
    METADATA,
    *_columns({"id": int, "at": float, "who": str, "action": str, "resource": str, "remote": str}),
    *_columns({"request_id": str | None, "outcome": str | None, "reason": str | None}),
)
probes = Table(  # written by api: one row, to see whether the database can be written to
    "probes",
    METADATA,
    *_columns({"id": int, "at": float}),
)
