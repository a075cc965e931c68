"""The folder of cell files; every cell is checked completely before use, including its home position."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.cell import Cell, ThrownBody, load_cell, mended_cell, read_source, tool_shapes
from planner.certificate import Examination
from planner.errors import CellError
from planner.geometry import SELF_CLEARANCE_M, NeverClear, held_object, never_clear, pierced
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory

# Beginnings of keys on which it does not depend whether the arm can stand at home; by its chain, within a centimetre.
NOT_OF_HOME = ("kinematics.calibration", "tool.mass_kg", "gripper.", "safety.", "timing.", "link.", "sim.")

OWN_CELLS = Path("cells")
PACKAGES = Path(__file__).parent.parent
SHIPPED_CELLS = (PACKAGES / "cells", PACKAGES / "fling" / "cells")  # of a checkout, and of the installed package


def open_cell(path: Path | str) -> Cell:
    """Returns the cell of a file after certifying that the arm can stand at its home.

    Raises:
        CellError: a field of the file is refused, or home violates the limits or the surroundings.
    """
    return checked(load_cell(path))


def default_cells_folder() -> Path:
    """Returns the first folder with cell files: `cells` here, in the checkout, or of the installed package."""
    candidates = (OWN_CELLS, *SHIPPED_CELLS)
    return next((folder for folder in candidates if any(folder.glob("*.toml"))), SHIPPED_CELLS[0]).resolve()


def is_shipped(path: Path) -> bool:
    """Returns whether a cell file came with Fling, and is not in the folder that the user works in."""
    folder = path.resolve().parent
    return folder != OWN_CELLS.resolve() and folder in [each.resolve() for each in SHIPPED_CELLS]


def checked(cell: Cell) -> Cell:
    """Returns a cell after certifying that the arm can stand at its home; what it is changed into is certified, too.

    Raises:
        CellError: see `check_home`.
    """
    cell = replace(cell, check=check_home)
    check_home(cell)
    return cell


def check_home(cell: Cell) -> None:
    """Certifies a standstill at home.

    Raises:
        CellError: home violates a limit or the surroundings; the reason names the check, its value and its limit. Or
            no posture is clear of the tool.
    """
    for fault in home_faults(cell):
        raise fault


def home_faults(cell: Cell) -> list[CellError]:
    """Returns what a standstill at home violates, a fault for each check; or how the tool is in the arm's way."""
    if in_the_way := never_clear(cell.robot, cell.tool.capsules, cell.surroundings):
        return [_in_the_way(cell, pair) for pair in in_the_way]
    if isinstance(cell.object, ThrownBody) and (touched := pierced(cell.robot, held_object(cell), cell.surroundings)):
        return [_held_in_the_way(cell, pair) for pair in touched]
    rest = np.tile(cell.home, (2, 1))
    zero = np.zeros((2, 6))
    problem = ThrowProblem(cell, cell.home, JointRelease(cell.home, np.zeros(6)), cell.limits)
    standing = Trajectory(cell.robot.sample_rate_hz, rest, zero, zero, release_index=1)
    found = []
    for check in Examination(problem, standing).failures:
        what = f" ({check.detail})" if check.detail else ""
        reason = f"violates {check.name}: {check.value:.4g} against {check.limit:.4g} {check.unit}{what}"
        found.append(CellError("home_rad", cell.home.tolist(), reason))
    return found


def _in_the_way(cell: Cell, pair: NeverClear) -> CellError:
    """Returns the fault of a tool that leaves the arm no posture."""
    part, tool = pair.names
    number = int(tool.rpartition("_")[2])
    own = len(cell.document["tool"]["capsules"])
    reason = (
        f"{tool} is too close to {part} in every posture: {1e3 * pair.most_m:.1f} mm at most against "
        f"{1e3 * SELF_CLEARANCE_M:g} mm; model a wide tool by several capsules that begin farther from the flange"
    )
    if number >= own and cell.document["tool"]["shapes"]:
        counts = [len(shape.capsules) for shape in tool_shapes(cell.document["tool"], cell.meshes)]
        of = int(np.searchsorted(np.cumsum(counts), number - own, side="right"))
        return CellError(f"tool.shapes[{of}]", cell.document["tool"]["shapes"][of].get("shape", "box"), reason)
    return CellError(f"tool.capsules[{number}].radius_m", cell.tool.capsules[number].radius_m, reason)


def _held_in_the_way(cell: Cell, pair: NeverClear) -> CellError:
    """Returns the fault of an object that lies in a link of the arm as it is held."""
    reason = (
        f"the object is too close to {pair.names[0]} in every posture: {1e3 * pair.most_m:.1f} mm at most against "
        f"{1e3 * SELF_CLEARANCE_M:g} mm; say how it lies in the hand by position_m and rotation_vector_rad"
    )
    return CellError("object.in_tool", cell.document["object"]["in_tool"], reason)


def file_faults(path: Path | str) -> list[CellError]:
    """Returns every fault of a cell file, empty for a good cell.

    Its home is judged where no other fault bears on that, with the published chain if the calibration file is at fault.
    """
    try:
        source = read_source(path)
    except CellError as error:
        return [error]
    faults, cell = mended_cell(source)
    if cell is None or not all(fault.field.startswith(NOT_OF_HOME) for fault in faults):
        return faults
    return [*faults, *home_faults(cell)]
