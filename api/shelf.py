"""The cell files of a folder, read again when they change."""

from __future__ import annotations

from pathlib import Path

from planner.cell import Cell, parse_cell
from planner.cell_folder import check_home
from planner.errors import CellError


class CellShelf:
    """Cells by name, as they are on disk now."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[str, tuple[bytes, Cell]] = {}

    def names(self) -> list[str]:
        """Returns the names of the cell files, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def text(self, name: str) -> bytes | None:
        """Returns the file's bytes, or None where there is none of this name."""
        if name not in self.names():  # never a path made from a request
            return None
        try:
            return (self.folder / f"{name}.toml").read_bytes()
        except FileNotFoundError:
            return None

    def cell(self, name: str) -> Cell | None:
        """Returns the cell, or None where there is none of this name.

        Raises:
            CellError: the file is refused.
        """
        text = self.text(name)
        if text is None:
            return None
        known = self._read.get(name)
        if known is None or known[0] != text:
            cell = parse_cell(text, name)
            check_home(cell)
            known = self._read[name] = (text, cell)
        return known[1]

    def faults(self) -> dict[str, str]:
        """Returns the files that are refused, with the reason."""
        found = {}
        for name in self.names():
            try:
                self.cell(name)
            except CellError as error:
                found[name] = str(error)
        return found
