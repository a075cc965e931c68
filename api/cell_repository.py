"""Cell files of a folder, read again when they change on disk."""

from __future__ import annotations

from pathlib import Path

from planner.cell import Cell, parse_cell
from planner.cell_folder import check_home
from planner.errors import CellError


class CellRepository:
    """Cells by name.

    Args:
        folder: Folder of the cell files `<name>.toml`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cache: dict[str, tuple[bytes, Cell]] = {}

    def names(self) -> list[str]:
        """Returns the names of the cell files, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def text(self, name: str) -> bytes | None:
        """Returns the content of a cell file, or None if there is no such cell."""
        if name not in self.names():  # a name from a request never becomes a path
            return None
        try:
            return (self.folder / f"{name}.toml").read_bytes()
        except FileNotFoundError:
            return None

    def cell(self, name: str) -> Cell | None:
        """Returns a cell, or None if there is no such cell.

        Raises:
            CellError: The file is refused.
        """
        text = self.text(name)
        if text is None:
            return None
        cached = self._cache.get(name)
        if cached is None or cached[0] != text:
            cell = parse_cell(text, name)
            check_home(cell)
            cached = self._cache[name] = (text, cell)
        return cached[1]

    def faults(self) -> dict[str, str]:
        """Returns the refused cell files with the reasons."""
        found = {}
        for name in self.names():
            try:
                self.cell(name)
            except CellError as error:
                found[name] = str(error)
        return found
