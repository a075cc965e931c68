"""Cells by name or by file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner import cell_folder
from planner.cell import Cell, cell_of_keys
from planner.errors import CellError


def cells_folder() -> Path:
    """Returns the folder of cell files: FLING_CELLS, `cells` here, or the cells that Fling ships."""
    given = os.environ.get("FLING_CELLS")
    return Path(given) if given else cell_folder.default_cells_folder()


def cell_names() -> list[str]:
    """Returns the names of the cells in the folder of cell files, sorted."""
    return sorted(path.stem for path in cells_folder().glob("*.toml"))


def open_cell(cell: str | Path | Mapping[str, Any]) -> Cell:
    """Returns a checked cell.

    Args:
        cell: name of a file in the folder of cell files, path of a file (.toml), or the keys of such a file, to which
            `name` may be added: `{"robot": "ur5e", "link": {"kind": "sim"}}`.

    Raises:
        CellError: there is no such cell, a field is refused, or its home violates a limit.
    """
    if isinstance(cell, Mapping):
        return cell_folder.checked(cell_of_keys(cell))
    if not isinstance(cell, str | Path):
        raise CellError("cell", cell, "must be a name, the path of a file, or the keys of one")
    path = Path(cell)
    if path.suffix != ".toml":
        path = cells_folder() / f"{cell}.toml"
        if not os.path.isfile(path):  # also of a name that is too long for a file
            raise CellError(
                "cell", str(cell), f"is not one of {', '.join(cell_names())} in {cells_folder()} (FLING_CELLS)"
            )
    return cell_folder.open_cell(path)
