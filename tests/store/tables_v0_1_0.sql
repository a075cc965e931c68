-- Tables of version 0.1.0, as its migrations made them; {types} depend on the database.

CREATE TABLE schema_steps (number INTEGER PRIMARY KEY);

CREATE TABLE plans (
    id TEXT PRIMARY KEY, created_at {float} NOT NULL, cell TEXT NOT NULL, cell_sha256 TEXT NOT NULL,
    backend TEXT NOT NULL, summary {bytes} NOT NULL, document {bytes} NOT NULL);

CREATE TABLE executions (
    id TEXT PRIMARY KEY, plan_id TEXT NOT NULL REFERENCES plans (id), cell TEXT NOT NULL, mode TEXT NOT NULL,
    dry_run BOOLEAN NOT NULL, requested_by TEXT NOT NULL, created_at {float} NOT NULL,
    abort_requested_at {float}, claimed_at {float}, executor_id TEXT, state TEXT NOT NULL, outcome TEXT,
    reason TEXT, metrics JSON, finished_at {float});

CREATE UNIQUE INDEX one_active_execution_per_cell ON executions (cell) WHERE state <> 'finished';

CREATE TABLE events (
    id {row_id}, execution_id TEXT NOT NULL REFERENCES executions (id), at {float} NOT NULL,
    kind TEXT NOT NULL, data JSON NOT NULL);

CREATE INDEX events_of_execution ON events (execution_id, id);

CREATE TABLE recordings (
    execution_id TEXT PRIMARY KEY REFERENCES executions (id), mcap {bytes} NOT NULL, csv {bytes} NOT NULL);

CREATE TABLE cells (
    cell TEXT PRIMARY KEY, executor_id TEXT NOT NULL, heartbeat_at {float} NOT NULL, link_kind TEXT NOT NULL,
    robot JSON NOT NULL, fault JSON, read_only BOOLEAN NOT NULL, acknowledge_handled_at {float},
    acknowledge_requested_at {float}, acknowledged_by TEXT);

CREATE TABLE idempotency (
    scope TEXT NOT NULL, key TEXT NOT NULL, body_sha256 TEXT NOT NULL, resource_id TEXT NOT NULL,
    created_at {float} NOT NULL, PRIMARY KEY (scope, key));

CREATE TABLE audit (
    id {row_id}, at {float} NOT NULL, who TEXT NOT NULL, action TEXT NOT NULL, resource TEXT NOT NULL,
    remote TEXT NOT NULL);
