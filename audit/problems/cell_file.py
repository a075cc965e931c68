"""The files of a drawn cell: its TOML, and meshes and points beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from planner.cell import Cell, cell_of, source_of


@dataclass(frozen=True)
class CellFiles:
    """A cell as it is written down.

    Attributes:
        name: of the cell.
        keys: of its file.
        beside: contents of the files beside it, by name.
    """

    name: str
    keys: Mapping[str, Any]
    beside: Mapping[str, bytes] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Writes the files into a folder that is there; returns the path of the cell file."""
        for name, content in self.beside.items():
            (folder / name).write_bytes(content)
        path = folder / f"{self.name}.toml"
        path.write_text(toml_text(self.keys), encoding="utf-8")
        return path

    def read(self) -> Cell:
        """Returns the cell that the planner reads from the files.

        Raises:
            CellError: a field of it is refused.
        """
        with TemporaryDirectory() as folder:
            path = self.write(Path(folder))
            return cell_of(source_of(path, path.read_bytes()))


def toml_text(keys: Mapping[str, Any]) -> str:
    """Returns keys as TOML: plain ones first, then each table."""
    plain = [f"{name} = {_value(value)}" for name, value in keys.items() if not isinstance(value, Mapping)]
    for table, entries in keys.items():
        if isinstance(entries, Mapping):
            plain += ["", f"[{table}]", *(f"{name} = {_value(value)}" for name, value in entries.items())]
    return "\n".join(plain) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_value(each)}" for name, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value)
