"""What a cell is read from: the bytes of its file, and of the calibration file beside it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.documents import NotToml, parse_toml, read_file
from planner.errors import CellError, FileRefused

CELL_BYTES = 500_000  # [byte] of a cell file; a usual one has 2,000, and a box of its surroundings 60
CALIBRATION_BYTES = 20_000  # [byte] of a calibration file; a driver's has 1,000
CALIBRATION_PATTERN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,127}")  # a plain file name: no folder, not hidden


@dataclass(frozen=True)
class CellSource:
    """What a cell is read from; equal sources are equal cells.

    Attributes:
        name: of the cell.
        text: content of the cell file.
        calibration: content of the calibration file that it names; None where it names none, or there is none.
    """

    name: str
    text: bytes
    calibration: bytes | None = None

    @property
    def sha256(self) -> str:
        """Hash of the cell file's bytes, and of those of its calibration file, if it has one."""
        if self.calibration is None:
            return hashlib.sha256(self.text).hexdigest()
        return hashlib.sha256(self.text + b"\0" + self.calibration).hexdigest()


def read_source(path: Path | str) -> CellSource:
    """Returns the content of a cell file and of its calibration file.

    Raises:
        CellError: a file cannot be read, is no file, or is too large.
    """
    path = Path(path)
    try:
        text = read_file(path, CELL_BYTES)
    except FileRefused as error:
        raise CellError("file", str(path), error.reason) from error
    beside = _path_beside(path, text)
    if beside is None or not beside.exists():
        return CellSource(path.stem, text)  # `cell_of` says that it is missing
    try:
        return CellSource(path.stem, text, read_file(beside, CALIBRATION_BYTES))
    except FileRefused as error:
        raise CellError("kinematics.calibration", beside.name, error.reason) from error


def calibration_path(path: Path) -> Path | None:
    """Returns the path of the calibration file that a cell file names, whether it exists; None where it names none."""
    try:
        return _path_beside(path, read_file(path, CELL_BYTES))
    except FileRefused:
        return None


def _path_beside(path: Path, text: bytes) -> Path | None:
    try:
        file = calibration_name(parse_toml(text))
    except (CellError, NotToml):
        return None  # `cell_of` says what is wrong
    return None if file is None else path.with_name(file)


def calibration_name(document: Mapping[str, Any]) -> str | None:
    """Returns the name of the calibration file that a cell file names, None where it names none.

    Raises:
        CellError: it is not a plain file name.
    """
    table = document.get("kinematics")
    name = table.get("calibration") if isinstance(table, Mapping) else None
    if name is None:
        return None
    if not isinstance(name, str) or not CALIBRATION_PATTERN.fullmatch(name):
        raise CellError("kinematics.calibration", name, "must be the name of a file beside the cell file")
    return name
