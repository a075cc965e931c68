"""The cell file, watched: between executions the executor continues with what the file says now."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from planner.cell import Cell, calibration_path, mesh_paths
from planner.cell_folder import open_cell
from planner.errors import CellError

Signature = tuple[int, int, int]  # of a file: inode, size, time of the last change [ns]


class CellWatch:
    """Notices changes of a cell file, and of the calibration file and the meshes that it names.

    Attributes:
        fault: why the file is refused as it is now, in the form of a latched fault; None while it is good.
    """

    def __init__(self, cell: Cell, path: Path) -> None:
        self.sha256 = cell.sha256
        self.path = path
        self.fault: dict[str, Any] | None = None
        self._seen: list[Signature | None] = []
        self._beside: list[Path] = []
        self._looked = False

    def look(self) -> Cell | None:
        """Returns the cell where the file has changed to another good one; None where there is nothing new."""
        seen = self._signatures()
        if self._looked and seen == self._seen:
            return None
        self._seen = seen
        self._looked = True
        try:
            cell = open_cell(self.path)
        except CellError as error:
            self.fault = {
                "outcome": "cell_file",
                "reason": f"the cell file is refused: {error}; correct it, and the executor reads it again",
                "execution_id": None,
                "at": time.time(),
            }
            return None
        self.fault = None
        if cell.sha256 == self.sha256:
            return None
        self.sha256 = cell.sha256
        return cell

    def _signatures(self) -> list[Signature | None]:
        """Returns the signatures of the cell file and of the files beside it; None for one that is not there."""
        own = _signature(self.path)
        if not self._looked or own != self._seen[0]:
            calibration = calibration_path(self.path)
            self._beside = mesh_paths(self.path) + ([] if calibration is None else [calibration])
        return [own, *map(_signature, self._beside)]


def _signature(path: Path) -> Signature | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns
