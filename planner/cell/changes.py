"""A cell changed in code: by the keys of its file, and checked like one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from planner.arrays import plain
from planner.cell.file import cell_of_document
from planner.cell.model import Cell
from planner.cell.source import CellSource

IN_CODE = "cell"  # name of a cell that is stated in code without one


def cell_of_keys(keys: Mapping[str, Any]) -> Cell:
    """Returns the cell that the keys of a cell file describe; `name` may stand among them.

    Raises:
        CellError: a field is refused, or a calibration file is named, which only a file beside it can be.
    """
    given = plain(keys)
    name = str(given.pop("name", IN_CODE))
    return cell_of_document(given, CellSource(name, json.dumps(given, sort_keys=True, default=str).encode()))


def changed(cell: Cell, tables: Mapping[str, Mapping[str, Any]]) -> Cell:
    """Returns a cell with other values of some keys of its file, and a hash of its own.

    Args:
        cell: to be changed; what a profile or a calibration file has taught stays.
        tables: of the file, by name, with the keys that change.

    Raises:
        CellError: a field is refused.
    """
    document = {**cell.document, **{name: {**cell.document[name], **plain(keys)} for name, keys in tables.items()}}
    source = CellSource(cell.name, json.dumps(document, sort_keys=True, default=str).encode(), None, cell.meshes)
    read = cell_of_document(document, source, published=True)
    parts: dict[str, Any] = {name: getattr(read, name) for name in tables}
    return replace(cell, document=document, **parts)
