"""Liveness of a cell's executor, from its last heartbeat, and readiness of its robot."""

from __future__ import annotations

import time
from typing import Any

from api.http import ProblemDetails
from store import CellRow

HEARTBEAT_FRESH_S = 2.0  # [s] an executor beats several times a second


def is_alive(row: CellRow | None) -> bool:
    """Returns whether the last heartbeat is younger than `HEARTBEAT_FRESH_S`."""
    return row is not None and time.time() - row.heartbeat_at < HEARTBEAT_FRESH_S


def executor_document(row: CellRow | None) -> dict[str, Any] | None:
    """Returns the executor of a cell as JSON; None if it never had one."""
    if row is None:
        return None
    age = max(0.0, time.time() - row.heartbeat_at)
    return {"id": row.executor_id, "alive": is_alive(row), "heartbeat_age_s": age, "read_only": row.read_only}


def check_ready(row: CellRow | None, cell: str) -> None:
    """Checks that the cell's executor is alive, may move the robot and has latched no fault.

    Raises:
        ProblemDetails: `robot-not-ready`, with the reason in words.
    """
    reason = _reason_not_ready(row, cell)
    if reason is not None:
        raise ProblemDetails("robot-not-ready", reason, cell=cell, fault=None if row is None else row.fault)


def _reason_not_ready(row: CellRow | None, cell: str) -> str | None:
    if row is None:
        return f"cell {cell!r} has no executor: start one with 'fling executor --cell {cell}'"
    if not is_alive(row):
        return f"the executor of cell {cell!r} is gone"
    if row.read_only:
        return f"the executor of cell {cell!r} does not move its robot (--read-only)"
    if row.fault is not None:
        return f"a fault is latched: {row.fault.get('reason', row.fault)}; check the robot, then acknowledge it"
    return None
