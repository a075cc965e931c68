"""Table definitions. Every column has one writer: [api] the service, [executor] the executor daemon of the cell.

The tables are created by `store/migrations.py`; a test compares the two.
"""

from __future__ import annotations

from sqlalchemy import JSON, Boolean, Column, Double, ForeignKey, Index, LargeBinary, MetaData, Table, Text, text
from sqlalchemy.types import BigInteger, Integer

METADATA = MetaData()
ROW_ID = BigInteger().with_variant(Integer, "sqlite")

plans = Table(  # [api], immutable
    "plans",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("created_at", Double, nullable=False),
    Column("cell", Text, nullable=False),
    Column("cell_sha256", Text, nullable=False),
    Column("backend", Text, nullable=False),
    Column("summary", LargeBinary, nullable=False),  # the document without its trajectory
    Column("document", LargeBinary, nullable=False),
)

executions = Table(
    "executions",
    METADATA,
    Column("id", Text, primary_key=True),  # [api] …
    Column("plan_id", Text, ForeignKey("plans.id"), nullable=False),
    Column("cell", Text, nullable=False),
    Column("mode", Text, nullable=False),
    Column("dry_run", Boolean, nullable=False),
    Column("requested_by", Text, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("abort_requested_at", Double),  # … [api]
    Column("claimed_at", Double),  # [executor] …
    Column("executor_id", Text),
    Column("state", Text, nullable=False),  # [api] inserts 'queued' and may abort an unclaimed execution
    Column("outcome", Text),
    Column("reason", Text),
    Column("metrics", JSON(none_as_null=True)),
    Column("finished_at", Double),  # … [executor]
)

# The database itself enforces one unfinished execution per cell.
one_active = Index(
    "one_active_execution_per_cell",
    executions.c.cell,
    unique=True,
    sqlite_where=text("state <> 'finished'"),
    postgresql_where=text("state <> 'finished'"),
)

events = Table(  # [executor]; the first event of an execution: [api]
    "events",
    METADATA,
    Column("id", ROW_ID, primary_key=True, autoincrement=True),
    Column("execution_id", Text, ForeignKey("executions.id"), nullable=False),
    Column("at", Double, nullable=False),
    Column("kind", Text, nullable=False),
    Column("data", JSON, nullable=False),
)
events_of_execution = Index("events_of_execution", events.c.execution_id, events.c.id)

recordings = Table(  # [executor]
    "recordings",
    METADATA,
    Column("execution_id", Text, ForeignKey("executions.id"), primary_key=True),
    Column("mcap", LargeBinary, nullable=False),
    Column("csv", LargeBinary, nullable=False),
)

cells = Table(
    "cells",
    METADATA,
    Column("cell", Text, primary_key=True),  # [executor] …
    Column("executor_id", Text, nullable=False),
    Column("heartbeat_at", Double, nullable=False),
    Column("link_kind", Text, nullable=False),
    Column("robot", JSON, nullable=False),
    Column("fault", JSON(none_as_null=True)),
    Column("read_only", Boolean, nullable=False),
    Column("acknowledge_handled_at", Double),  # … [executor]
    Column("acknowledge_requested_at", Double),  # [api] …
    Column("acknowledged_by", Text),  # … [api]
)

idempotency = Table(  # [api]
    "idempotency",
    METADATA,
    Column("scope", Text, primary_key=True),
    Column("key", Text, primary_key=True),
    Column("body_sha256", Text, nullable=False),
    Column("resource_id", Text, nullable=False),
    Column("created_at", Double, nullable=False),
)

audit = Table(  # [api], append only
    "audit",
    METADATA,
    Column("id", ROW_ID, primary_key=True, autoincrement=True),
    Column("at", Double, nullable=False),
    Column("who", Text, nullable=False),
    Column("action", Text, nullable=False),
    Column("resource", Text, nullable=False),
    Column("remote", Text, nullable=False),
)
