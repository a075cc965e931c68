"""What changed between two versions of a cell: key by key, and as text."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from typing import Any

from api.schemas import iso_time
from planner.cell import mesh_hashes
from planner.documents import NotToml, parse_toml
from planner.errors import quoted
from store import CellVersionRow

FILE = "file"  # key of a version that is no TOML, with the reason
CALIBRATION = "calibration file"  # a change of its content; its name is the key kinematics.calibration
MESHES = "mesh files"  # the same of meshes, by their hashes


def changed_keys(before: CellVersionRow, after: CellVersionRow) -> list[dict[str, Any]]:
    """Returns the keys that differ, sorted: `key`, `before`, `after`; null where a file leaves the key out."""
    old = _keys(before)
    new = _keys(after)
    keys = sorted(key for key in {*old, *new} if old.get(key) != new.get(key))
    changes = [{"key": key, "before": old.get(key), "after": new.get(key)} for key in keys]
    if before.calibration != after.calibration:
        changes.append({"key": CALIBRATION, "before": _size(before), "after": _size(after)})
    if _meshes(before) != _meshes(after):
        changes.append({"key": MESHES, "before": _meshes(before), "after": _meshes(after)})
    return changes


def history_document(cell: str, versions: list[CellVersionRow]) -> dict[str, Any]:
    """Returns the JSON of a cell's versions, newest first, each with what changed from the one before.

    Args:
        cell: Name of the cell.
        versions: Newest first.
    """
    earlier = [*versions[1:], None][: len(versions)]  # a file that was never good has none
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
    old, new = (row.text.decode(errors="replace").splitlines(keepends=True) for row in (before, after))
    diff = "".join(difflib.unified_diff(old, new, names[0], names[1]))
    apart = before.calibration != after.calibration
    return diff + (f"calibration file: {_size(before)} before, {_size(after)} after\n" if apart else "")


def _keys(row: CellVersionRow) -> dict[str, Any]:
    """Returns the values of a version by dotted key; of a file that was refused, as far as it is TOML and JSON."""
    try:
        flat = _flat(parse_toml(row.text))
    except NotToml as error:
        return {FILE: str(error)}
    return {key: _json_value(value) for key, value in flat.items()}


def _json_value(value: Any) -> Any:
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):  # a date, NaN
        return quoted(value)
    return value


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat


def _meshes(row: CellVersionRow) -> dict[str, Any] | None:
    """Returns the hashes of the mesh files that a version names; null of one that is refused, None without any."""
    return None if row.meshes is None else mesh_hashes(row.meshes)


def _size(row: CellVersionRow) -> str | None:
    return None if row.calibration is None else f"{len(row.calibration)} bytes"
