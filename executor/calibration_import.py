"""Import of a controller's kinematics: the calibration file beside a cell file, and what it changes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executor.robot import KinematicsInfo, read_kinematics
from planner.calibration import ImplausibleChain, calibrated, calibration_text, transforms_of_table
from planner.cell import Cell, calibration_path, cell_of, read_source
from planner.errors import CellError
from planner.kinematics import ChainDifference, chain_difference


class ImportFailed(Exception):
    """The controller's kinematics cannot be imported; the text says why."""


@dataclass(frozen=True)
class ImportedCalibration:
    """A calibration file that was written.

    Attributes:
        path: of the file.
        hash: by which UR's drivers know the arm.
        checksums: of the joints (6,), as the controller counts them.
        status: of the calibration, as the controller counts.
        difference: of the arm from the published table.
        is_named: whether the cell file names this file.
    """

    path: Path
    hash: str
    checksums: tuple[int, ...]
    status: int
    difference: ChainDifference
    is_named: bool

    def as_document(self) -> dict[str, Any]:
        """Returns the import as JSON."""
        return {
            "file": str(self.path),
            "hash": self.hash,
            "checksums": list(self.checksums),
            "status": self.status,
            "deviation_median_m": self.difference.median_m,
            "deviation_largest_m": self.difference.largest_m,
            "deviation_largest_rad": self.difference.largest_rad,
            "named_in_cell": self.is_named,
        }


def import_calibration(cell_path: Path) -> ImportedCalibration:
    """Writes the kinematics that a cell's controller reports to the file that the cell names, or will have to name.

    Raises:
        ImportFailed: the cell file is refused, the controller does not answer, its arm is of another model, or the
            file cannot be written.
    """
    try:
        cell = cell_of(read_source(cell_path), published=True)
        named = calibration_path(cell_path)
    except CellError as error:
        raise ImportFailed(f"{cell_path}: {error}") from error
    info = _told_by(cell)
    try:
        arm = calibrated(cell.robot, transforms_of_table(info.table))
    except ImplausibleChain as error:
        raise ImportFailed(f"the controller's arm is not a {cell.robot.name}: {error}") from error
    assert arm.fixed is not None
    path = named or cell_path.with_name(f"{cell_path.stem}-kinematics.yaml")
    _replace(path, calibration_text(arm.fixed, info.table.hash))
    difference = chain_difference(cell.robot, arm)
    return ImportedCalibration(path, info.table.hash, info.checksums, info.status, difference, named is not None)


def _told_by(cell: Cell) -> KinematicsInfo:
    try:
        return read_kinematics(cell.link.host)
    except (OSError, ValueError) as error:
        raise ImportFailed(f"the controller at {cell.link.host} does not report its kinematics: {error}") from error


def _replace(path: Path, text: str) -> None:
    """Writes a file whole, or not at all."""
    new = path.with_name(f".{path.name}.new")
    try:
        new.write_text(text, encoding="utf-8")
        os.replace(new, path)
    except OSError as error:
        raise ImportFailed(f"{path} cannot be written: {error.strerror}") from error


def report(imported: ImportedCalibration, cell: str) -> str:
    """Returns the import in words."""
    apart = imported.difference
    lines = [
        f"{imported.path}: {imported.hash}, calibration status {imported.status}",
        f"The arm deviates from the published table by {apart.words(2)} and {apart.largest_rad * 1e3:.2f} mrad.",
    ]
    if not imported.is_named:
        named = f'[kinematics]\ncalibration = "{imported.path.name}"'
        lines.append(f"Add to {cell}.toml, for the planner to use it:\n\n{named}")
    return "\n".join(lines)
