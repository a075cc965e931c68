"""Every fault of a cell file at once: a faulty key is reported, replaced by a good value, and the file read again."""

from __future__ import annotations

import copy
import re
from dataclasses import replace
from typing import Any

from planner.cell.fields import UNKNOWN_KEY
from planner.cell.file import DEFAULTS, cell_of_document, toml_of
from planner.cell.model import Cell
from planner.cell.source import CellSource
from planner.errors import CellError
from planner.grippers import KINDS

FAULTS_MAX = 100  # a file with more of them is no cell file
# Of required keys, so that the others can be read.
STAND_IN = {"robot": "ur5e", "link.kind": "sim", "arm_data.source": "a stand-in"}
OF_ARM = ("limits.joint_", "home_rad", "sim.polyscope", "kinematics.")  # not judged without knowing the arm
# Nor these without the gripper's kind.
OF_KIND = tuple(f"gripper.{key}" for kind in KINDS.values() for key in kind.keys)
ENTRY = {  # of tools and shapes, which have no defaults
    "from_m": [0.0, 0.0, 0.0],
    "to_m": [0.0, 0.0, 0.0],
    "radius_m": 0.01,
    "lower_m": [-1.0, -1.0, -1.0],
    "upper_m": [1.0, 1.0, 1.0],
    "pose": {"position_m": [0.0, 0.0, -1.0], "rotation_vector_rad": [0.0, 0.0, 0.0]},
    "size_m": [0.1, 0.1, 0.1],
    "length_m": 0.1,
    "clearance_m": 0.0,
    "a": "tool",
    "b": "forearm",
}


def mended_cell(source: CellSource) -> tuple[list[CellError], Cell | None]:
    """Returns the faults of a cell file, and the cell with good values in their place.

    The faults are in the order of reading, one a key; of a list the first wrong entry. No cell where a fault has no
    good value.
    """
    try:
        given = toml_of(source)
    except CellError as error:
        return [error], None
    found: dict[str, CellError] = {}
    while isinstance(read := _read(given, source), CellError) and len(found) < FAULTS_MAX:
        key = _key(read.field)
        if key in found:
            break
        if key != "robot" or not any(other.startswith("arm_data.") for other in found):
            found[key] = read  # an arm does not lack what was given and refused
        if key == "robot":
            given.pop("arm_data", None)  # its stand-in is complete
        if key == "name":
            source = replace(source, name="cell")
        elif not _mend(given, key, read.reason.startswith(UNKNOWN_KEY)):
            break
    unjudged = (*(OF_ARM if "robot" in found else ()), *(OF_KIND if "gripper.kind" in found else ()))
    faults = [fault for key, fault in found.items() if not key.startswith(unjudged)]
    return faults, None if isinstance(read, CellError) else read


def _read(given: dict[str, Any], source: CellSource) -> Cell | CellError:
    """Returns the cell, or its first fault."""
    try:
        return cell_of_document(given, source)
    except CellError as error:
        return error


def _key(field: str) -> str:
    """Returns the key of a field: a trailing index is one of a plain list."""
    return re.sub(r"\[\d+\]$", "", field)


def _mend(given: dict[str, Any], key: str, is_unknown: bool) -> bool:
    """Replaces the value of a key by a good one; removes an unknown key. Returns whether that could be done.

    A shape of an unknown kind, or a mesh that is none, becomes a box, and such an object a ball: its other keys are not
    judged.
    """
    *path, leaf = re.findall(r"[^.\[\]]+", key)
    table: Any = given
    defaults: Any = DEFAULTS
    try:
        for step in path:
            if isinstance(table, list):
                table = table[int(step)]
                defaults = ENTRY
            else:
                table = table.setdefault(step, {})
                defaults = defaults[step]
        if is_unknown or (leaf not in defaults and leaf not in ("shape", "file", "scale")):
            del table[leaf]
        elif leaf in ("shape", "file", "scale"):
            table.clear()
            if path != ["object"]:
                table.update({corner: ENTRY[corner] for corner in ("lower_m", "upper_m")})
        else:
            table[leaf] = copy.deepcopy(STAND_IN.get(key, defaults[leaf]))
            if table[leaf] is None:
                del table[leaf]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError):
        return False
    return True
