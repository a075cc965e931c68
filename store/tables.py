"""Table definitions.

A comment names the writer of each table, or of a column where a table has two: `api` is the service, `executor` the
executor daemon of the cell, `the driver` the process that plans a batch. Of an execution that no executor claimed, api
may also write the aborted result.

The tables are created by `store/migrations.py`; a test compares the two.
"""

from __future__ import annotations

from sqlalchemy import JSON, Boolean, Column, Double, ForeignKey, Index, LargeBinary, MetaData, Table, Text, text
from sqlalchemy.types import BigInteger, Integer

METADATA = MetaData()
ROW_ID = BigInteger().with_variant(Integer, "sqlite")

plans = Table(  # written by api, never changed
    "plans",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("created_at", Double, nullable=False),
    Column("cell", Text, nullable=False),
    Column("cell_sha256", Text, nullable=False),
    Column("backend", Text, nullable=False),
    Column("summary", LargeBinary, nullable=False),  # the document without its trajectory
    Column("document", LargeBinary, nullable=False),  # the whole document of an earlier version; else empty
    Column("request_id", Text),  # of the HTTP request that made it
    Column("samples", LargeBinary),  # the trajectory; see `store.samples`
)

experiments = Table(  # written by api, never changed
    "experiments",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("created_at", Double, nullable=False),
    Column("name", Text, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("settings", JSON, nullable=False),
)

executions = Table(
    "executions",
    METADATA,
    Column("id", Text, primary_key=True),  # api
    Column("plan_id", Text, ForeignKey("plans.id"), nullable=False),  # api
    Column("cell", Text, nullable=False),  # api
    Column("mode", Text, nullable=False),  # api
    Column("dry_run", Boolean, nullable=False),  # api
    Column("requested_by", Text, nullable=False),  # api
    Column("created_at", Double, nullable=False),  # api
    Column("abort_requested_at", Double),  # api
    Column("claimed_at", Double),  # executor
    Column("executor_id", Text),  # executor
    Column("state", Text, nullable=False),  # executor; api inserts 'queued'
    Column("outcome", Text),  # executor
    Column("reason", Text),  # executor
    Column("metrics", JSON(none_as_null=True)),  # executor
    Column("finished_at", Double),  # executor
    Column("experiment_id", Text, ForeignKey("experiments.id")),  # api
    Column("request_id", Text),  # api
)
executions_of_experiment = Index("executions_of_experiment", executions.c.experiment_id)

# The database itself enforces one unfinished execution per cell.
one_active = Index(
    "one_active_execution_per_cell",
    executions.c.cell,
    unique=True,
    sqlite_where=text("state <> 'finished'"),
    postgresql_where=text("state <> 'finished'"),
)

events = Table(  # written by executor; the first event of an execution by api
    "events",
    METADATA,
    Column("id", ROW_ID, primary_key=True, autoincrement=True),
    Column("execution_id", Text, ForeignKey("executions.id"), nullable=False),
    Column("at", Double, nullable=False),
    Column("kind", Text, nullable=False),
    Column("data", JSON, nullable=False),
)
events_of_execution = Index("events_of_execution", events.c.execution_id, events.c.id)

recordings = Table(  # written by executor
    "recordings",
    METADATA,
    Column("execution_id", Text, ForeignKey("executions.id"), primary_key=True),
    Column("mcap", LargeBinary, nullable=False),
    Column("csv", LargeBinary, nullable=False),  # the rows of an earlier version; else empty
    Column("samples", LargeBinary),  # the rows; see `store.samples`
)

landings = Table(  # written by api; by executor for what a simulated camera observed; never changed
    "landings",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("execution_id", Text, ForeignKey("executions.id"), nullable=False),
    Column("at", Double, nullable=False),
    Column("source", Text, nullable=False),
    Column("reported_by", Text, nullable=False),
    Column("position", JSON(none_as_null=True)),
    Column("std_m", Double),
    Column("result", Text),
    Column("radius_m", Double),
)
landings_of_execution = Index("landings_of_execution", landings.c.execution_id, landings.c.id)

cells = Table(
    "cells",
    METADATA,
    Column("cell", Text, primary_key=True),  # executor
    Column("executor_id", Text, nullable=False),  # executor
    Column("heartbeat_at", Double, nullable=False),  # executor
    Column("link_kind", Text, nullable=False),  # executor
    Column("robot", JSON, nullable=False),  # executor
    Column("fault", JSON(none_as_null=True)),  # executor
    Column("read_only", Boolean, nullable=False),  # executor
    Column("acknowledge_handled_at", Double),  # executor
    Column("acknowledge_requested_at", Double),  # api
    Column("acknowledged_by", Text),  # api
)

idempotency = Table(  # written by api
    "idempotency",
    METADATA,
    Column("scope", Text, primary_key=True),
    Column("key", Text, primary_key=True),
    Column("body_sha256", Text, nullable=False),
    Column("resource_id", Text, nullable=False),
    Column("created_at", Double, nullable=False),
)

audit = Table(  # written by api, append only
    "audit",
    METADATA,
    Column("id", ROW_ID, primary_key=True, autoincrement=True),
    Column("at", Double, nullable=False),
    Column("who", Text, nullable=False),
    Column("action", Text, nullable=False),
    Column("resource", Text, nullable=False),
    Column("remote", Text, nullable=False),
    Column("request_id", Text),
    Column("outcome", Text),  # "done", or the problem that it was refused with; null: done, by an earlier version
    Column("reason", Text),  # of a refusal
)

profiles = Table(  # written by api, never changed
    "profiles",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("created_at", Double, nullable=False),
    Column("cell", Text, nullable=False),
    Column("cell_sha256", Text, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("sha256", Text, nullable=False),  # of the document
    Column("document", LargeBinary, nullable=False),
    Column("cell_version", Integer),  # null: of an earlier version of Fling
)
profiles_of_cell = Index("profiles_of_cell", profiles.c.cell, profiles.c.id)

adoptions = Table(  # written by api, append only; a cell's newest line is what it uses
    "adoptions",
    METADATA,
    Column("id", ROW_ID, primary_key=True, autoincrement=True),
    Column("at", Double, nullable=False),
    Column("cell", Text, nullable=False),
    Column("profile_id", Text, ForeignKey("profiles.id")),  # null: the cell file's numbers again
    Column("adopted_by", Text, nullable=False),
)
adoptions_of_cell = Index("adoptions_of_cell", adoptions.c.cell, adoptions.c.id)

probes = Table(  # written by api: one row, to see whether the database can be written to
    "probes",
    METADATA,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("at", Double, nullable=False),
)

cell_versions = Table(  # written by api and executor, append only: whoever sees a version first
    "cell_versions",
    METADATA,
    Column("cell", Text, primary_key=True),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("sha256", Text, nullable=False),
    Column("text", LargeBinary, nullable=False),
    Column("calibration", LargeBinary),
    Column("seen_at", Double, nullable=False),
    Column("seen_by", Text, nullable=False),
)

batches = Table(
    "batches",
    METADATA,
    Column("id", Text, primary_key=True),  # api
    Column("created_at", Double, nullable=False),  # api
    Column("created_by", Text, nullable=False),  # api
    Column("request_id", Text),  # api
    Column("driven_by", Text, nullable=False),  # api: "service" or "command", whose drivers take it up
    Column("specification", LargeBinary, nullable=False),  # api: its requests, see `jobs.batches`
    Column("total", Integer, nullable=False),  # api: number of requests
    Column("state", Text, nullable=False),  # the driver; api inserts 'queued', and finishes what nobody drives
    Column("outcome", Text),  # the driver; see `state`
    Column("reason", Text),  # the driver; see `state`
    Column("counts", JSON, nullable=False),  # the driver: results by outcome
    Column("cancel_requested_at", Double),  # api
    Column("driver_id", Text),  # the driver
    Column("heartbeat_at", Double),  # the driver
    Column("started_at", Double),  # the driver: when it took the batch up
    Column("started_done", Integer, nullable=False),  # the driver: number of results there were then
    Column("finished_at", Double),  # the driver; see `state`
)

batch_results = Table(  # written by the driver of the batch, append only; a row a request
    "batch_results",
    METADATA,
    Column("batch_id", Text, ForeignKey("batches.id"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("problem_sha256", Text, nullable=False),
    Column("outcome", Text, nullable=False),  # "planned", or the type of the problem
    Column("planning_time_s", Double, nullable=False),
    Column("plan_id", Text),
    Column("trajectory_sha256", Text),
    Column("release_time_s", Double),
    Column("duration_s", Double),
    Column("release_speed_m_s", Double),
    Column("hit_probability", Double),
    Column("refusal", JSON(none_as_null=True)),
)
batch_results_of_problem = Index("batch_results_of_problem", batch_results.c.batch_id, batch_results.c.problem_sha256)
batch_results_of_plan = Index("batch_results_of_plan", batch_results.c.plan_id)

maps = Table(  # written by whoever makes the map: its runner process or `fling map`
    "maps",
    METADATA,
    Column("id", Text, primary_key=True),
    Column("created_at", Double, nullable=False),
    Column("cell", Text, nullable=False),
    Column("cell_version", Integer, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("made_by", Text, nullable=False),
    Column("definition_sha256", Text, nullable=False),
    Column("definition", JSON, nullable=False),
    Column("state", Text, nullable=False),
    Column("beat_at", Double),
    Column("cancel_requested_at", Double),  # api
    Column("finished_at", Double),
)
maps_of_cell = Index("maps_of_cell", maps.c.cell, maps.c.id)
one_map = Index("one_map_per_definition", maps.c.definition_sha256, unique=True)

landing_cells = Table(  # written by whoever makes the map
    "landing_cells",
    METADATA,
    Column("map_id", Text, ForeignKey("maps.id"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("round", Integer, nullable=False),
    Column("state", Integer, nullable=False),
    Column("plan_id", Text, ForeignKey("plans.id")),
    Column("samples_sha256", Text),
    Column("release_time_s", Double),
    Column("shift_early_m", Double),
    Column("shift_late_m", Double),
    Column("hit_probability", Double),
    Column("margin", Double),
    Column("margin_check", Text),
    Column("constraint_name", Text),
    Column("reason", Text),
)
landing_cells_of_plan = Index("landing_cells_of_plan", landing_cells.c.plan_id)
