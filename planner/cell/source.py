"""What a cell is read from: the bytes of its file, and what is beside it: a calibration file, meshes."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from planner.cell.meshes import cover_keys, covers_of, file_of, mesh_hashes
from planner.documents import NotToml, parse_toml, read_file
from planner.errors import CellError, FileRefused

CELL_BYTES = 500_000  # [byte] of a cell file; a usual one has 2,000, and a box of its surroundings 60
CALIBRATION_BYTES = 20_000  # [byte] of a calibration file; a driver's has 1,000
CALIBRATION_PATTERN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,127}")  # a plain file name: no folder, not hidden
TEXTS_KEPT = 32  # cell files of which it is known what they name


@dataclass(frozen=True)
class CellSource:
    """What a cell is read from; equal sources are equal cells.

    Attributes:
        name: of the cell.
        text: content of the cell file.
        calibration: content of the calibration file that it names; None where it names none, or there is none.
        meshes: what became of the mesh files that it names, see `covers_of`; None where it names none.
    """

    name: str
    text: bytes
    calibration: bytes | None = None
    meshes: bytes | None = None

    @property
    def sha256(self) -> str:
        """Hash of the cell file's bytes, and of what is beside it, if there is something."""
        meshes = None if self.meshes is None else json.dumps(mesh_hashes(self.meshes)).encode()
        beside = [b"\0" + each for each in (self.calibration, meshes) if each is not None]
        return hashlib.sha256(b"".join([self.text, *beside])).hexdigest()


def read_source(path: Path | str) -> CellSource:
    """Returns the content of a cell file and of its calibration file, and what becomes of its meshes.

    Raises:
        CellError: a file cannot be read, is no file, or is too large.
    """
    path = Path(path)
    try:
        text = read_file(path, CELL_BYTES)
    except FileRefused as error:
        raise CellError("file", str(path), error.reason) from error
    return source_of(path, text)


def source_of(path: Path, text: bytes) -> CellSource:
    """Returns a cell file's source if this were its content.

    Raises:
        CellError: a file beside it cannot be read, is no file, or is too large.
    """
    keys, calibration = _named_in(text)
    meshes = covers_of(path.parent, keys)
    beside = None if calibration is None else path.with_name(calibration)
    if beside is None or not beside.exists():
        return CellSource(path.stem, text, None, meshes)  # `cell_of` says that it is missing
    try:
        return CellSource(path.stem, text, read_file(beside, CALIBRATION_BYTES), meshes)
    except FileRefused as error:
        raise CellError("kinematics.calibration", beside.name, error.reason) from error


def calibration_path(path: Path) -> Path | None:
    """Returns the path of the calibration file that a cell file names, whether it exists; None where it names none."""
    try:
        _, name = _named_in(read_file(path, CELL_BYTES))
    except FileRefused:
        return None
    return None if name is None else path.with_name(name)


def mesh_paths(path: Path) -> list[Path]:
    """Returns the paths of the mesh files that a cell file names, whether they exist or not."""
    try:
        keys, _ = _named_in(read_file(path, CELL_BYTES))
    except FileRefused:
        return []
    return [path.parent / file_of(key) for key in keys]


@lru_cache(maxsize=TEXTS_KEPT)
def _named_in(text: bytes) -> tuple[tuple[str, ...], str | None]:
    """Returns the meshes and the calibration file that a cell file names; where it is wrong, `cell_of` says how.

    A service asks at every request, about the same text.
    """
    try:
        document = parse_toml(text)
    except NotToml:
        return (), None
    keys = tuple(cover_keys(document))
    try:
        return keys, calibration_name(document)
    except CellError:
        return keys, None


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
