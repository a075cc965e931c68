"""The store: everything the service and the executor share, and all SQL.

`Store` is the one door. SQLite (WAL) by default, PostgreSQL by its address. Times are seconds since the epoch (float).
"""

from store.errors import CellBusy, KeyTaken, StoreError, StoreUnavailable, UnknownExecution, UnknownPlan
from store.identifiers import new_id
from store.location import default_database_url
from store.rows import CellRow, EventRow, ExecutionRow, IdempotencyKey, PlanRow, RecordingRow
from store.store import Store

__all__ = [
    "CellBusy",
    "CellRow",
    "EventRow",
    "ExecutionRow",
    "IdempotencyKey",
    "KeyTaken",
    "PlanRow",
    "RecordingRow",
    "Store",
    "StoreError",
    "StoreUnavailable",
    "UnknownExecution",
    "UnknownPlan",
    "default_database_url",
    "new_id",
]
