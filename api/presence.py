"""Is anybody there? What the store knows of the executor of a cell."""

from __future__ import annotations

import time
from typing import Any

from api.settings import HEARTBEAT_FRESH_S
from store import CellRow


def is_alive(row: CellRow | None) -> bool:
    """Returns whether the executor beat within `HEARTBEAT_FRESH_S`."""
    return row is not None and time.time() - row.heartbeat_at < HEARTBEAT_FRESH_S


def executor_document(row: CellRow | None) -> dict[str, Any] | None:
    """Returns the executor as `GET /cells` shows it."""
    if row is None:
        return None
    age = max(0.0, time.time() - row.heartbeat_at)
    return {"id": row.executor_id, "alive": is_alive(row), "heartbeat_age_s": age, "read_only": row.read_only}
