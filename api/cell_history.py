"""What changed between two versions of a cell: key by key, and as text."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from typing import Any

from api.schemas import iso_time
from store import CellVersionRow

CALIBRATION = "calibration file"  # a change of its content; its name is the key kinematics.calibration


def changed_keys(before: CellVersionRow, after: CellVersionRow) -> list[dict[str, Any]]:
    """Returns the keys that differ, sorted: `key`, `before`, `after`; null where a file leaves the key out."""
    old = _flat(tomllib.loads(before.text.decode()))
    new = _flat(tomllib.loads(after.text.decode()))
    keys = sorted(key for key in {*old, *new} if old.get(key) != new.get(key))
    changes = [{"key": key, "before": old.get(key), "after": new.get(key)} for key in keys]
    if before.calibration != after.calibration:
        changes.append({"key": CALIBRATION, "before": _size(before), "after": _size(after)})
    return changes


def history_document(cell: str, versions: list[CellVersionRow]) -> dict[str, Any]:
    """Returns the JSON of a cell's versions, newest first, each with what changed from the one before.

    Args:
        cell: Name of the cell.
        versions: Newest first.
    """
    earlier = [*versions[1:], None]
    listed = [
        {
            "version": row.version,
            "sha256": row.sha256,
            "seen_at": iso_time(row.seen_at),
            "seen_by": row.seen_by,
            "changes": [] if before is None else changed_keys(before, row),
        }
        for row, before in zip(versions, earlier, strict=True)
    ]
    return {"cell": cell, "versions": listed}


def text_diff(before: CellVersionRow, after: CellVersionRow) -> str:
    """Returns the difference of two versions' cell files as a unified diff."""
    names = [
        f"{row.cell}.toml, version {row.version}" if row.version else f"{row.cell}.toml" for row in (before, after)
    ]
    old, new = (row.text.decode().splitlines(keepends=True) for row in (before, after))
    diff = "".join(difflib.unified_diff(old, new, names[0], names[1]))
    apart = before.calibration != after.calibration
    return diff + (f"calibration file: {_size(before)} before, {_size(after)} after\n" if apart else "")


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat


def _size(row: CellVersionRow) -> str | None:
    return None if row.calibration is None else f"{len(row.calibration)} bytes"
