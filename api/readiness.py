"""Whether a cell's robot may be asked to move, judged by what its executor last said."""

from __future__ import annotations

from api.errors import Problem
from api.presence import is_alive
from store import CellRow


def check_ready(row: CellRow | None, cell: str) -> None:
    """Refuses where the executor is absent, only looks on, or has latched a fault.

    Raises:
        Problem: `robot-not-ready`, with the reason in words.
    """
    reason = _reason(row, cell)
    if reason is not None:
        raise Problem("robot-not-ready", reason, cell=cell, fault=None if row is None else row.fault)


def _reason(row: CellRow | None, cell: str) -> str | None:
    if row is None:
        return f"cell {cell!r} has no executor: start one with 'fling executor --cell {cell}'"
    if not is_alive(row):
        return f"the executor of cell {cell!r} is gone"
    if row.read_only:
        return f"the executor of cell {cell!r} only looks on (--read-only)"
    if row.fault is not None:
        return f"a fault is latched: {row.fault.get('reason', row.fault)}; look, then acknowledge it"
    return None
