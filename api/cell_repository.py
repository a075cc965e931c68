"""Cell files of a folder, read again when they change on disk."""

from __future__ import annotations

from pathlib import Path

from planner.cell import Cell, CellSource, cell_of, read_source
from planner.cell_folder import check_home
from planner.errors import CellError


class UnknownCell(LookupError):
    """There is no such cell; the message says which there are."""


class CellRepository:
    """Cells by name.

    Args:
        folder: Folder of the cell files `<name>.toml`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cache: dict[str, tuple[CellSource, Cell]] = {}

    def names(self) -> list[str]:
        """Returns the names of the cell files, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def source(self, name: str) -> CellSource | None:
        """Returns the content of a cell's files, or None if there is no such cell.

        Raises:
            CellError: What has its name is no file, or cannot be read.
        """
        if name not in self.names():  # a name from a request never becomes a path
            return None
        return read_source(self.folder / f"{name}.toml")

    def cell(self, name: str) -> Cell | None:
        """Returns a cell, or None if there is no such cell.

        Raises:
            CellError: The file is refused.
        """
        source = self.source(name)
        return None if source is None else self._cell_of(source)

    def required(self, name: str) -> tuple[CellSource, Cell]:
        """Returns the content of a cell's files, and the cell.

        Raises:
            UnknownCell: There is no such cell.
            CellError: The file is refused.
        """
        source = self.source(name)
        if source is None:
            raise UnknownCell(f"no cell {name!r}; there are {', '.join(self.names())}")
        return source, self._cell_of(source)

    def faults(self) -> dict[str, str]:
        """Returns the refused cell files with the reasons."""
        found = {}
        for name in self.names():
            try:
                self.cell(name)
            except CellError as error:
                found[name] = str(error)
        return found

    def _cell_of(self, source: CellSource) -> Cell:
        cached = self._cache.get(source.name)
        if cached is None or cached[0] != source:
            cell = cell_of(source)
            check_home(cell)
            cached = self._cache[source.name] = (source, cell)
        return cached[1]
