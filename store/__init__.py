"""The database shared by service and executor: plans, batches, executions, cells, keys, audit trail …

`Store` is the only entry; all SQL of the project is in this package. SQLite in WAL mode by default, PostgreSQL by its
URL. Times are seconds since the epoch.
"""

from store.database import StoreError, StoreUnavailable, UnknownRow
from store.executions import TICK_PASSED, CellBusy
from store.idempotency_and_audit import KeyTaken
from store.many import BatchDriven, BatchLost, JobDriven, JobLost
from store.retention import Retention
from store.rows import (
    AuditLine,
    BatchResultRow,
    BatchRow,
    CellRow,
    CellVersionRow,
    EventRow,
    ExecutionRow,
    ExperimentRow,
    IdempotencyKey,
    JobCycleRow,
    JobRow,
    LandingCellRow,
    LandingRow,
    MapRow,
    PlanRow,
    ProfileRow,
    RecordingRow,
    RobotAction,
    TrackedTargetRow,
    derived_id,
    new_id,
    plan_sha256,
)
from store.samples import join_plan, pack_samples, pack_trajectory, samples_of_csv, split_plan
from store.store import Store

__all__ = [
    "TICK_PASSED",
    "AuditLine",
    "BatchDriven",
    "BatchLost",
    "BatchResultRow",
    "BatchRow",
    "CellBusy",
    "CellRow",
    "CellVersionRow",
    "EventRow",
    "ExecutionRow",
    "ExperimentRow",
    "IdempotencyKey",
    "JobCycleRow",
    "JobDriven",
    "JobLost",
    "JobRow",
    "KeyTaken",
    "LandingCellRow",
    "LandingRow",
    "MapRow",
    "PlanRow",
    "ProfileRow",
    "RecordingRow",
    "Retention",
    "RobotAction",
    "Store",
    "StoreError",
    "StoreUnavailable",
    "TrackedTargetRow",
    "UnknownRow",
    "derived_id",
    "join_plan",
    "new_id",
    "pack_samples",
    "pack_trajectory",
    "plan_sha256",
    "samples_of_csv",
    "split_plan",
]
