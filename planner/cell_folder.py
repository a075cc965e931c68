"""The folder of cell files; every cell is checked completely before use, including its home position."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from planner.cell import Cell, cell_faults, cell_of, load_cell, read_source
from planner.certificate import certify
from planner.errors import CellError
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory


def open_cell(path: Path | str) -> Cell:
    """Returns the cell of a file after certifying that the arm can stand at its home.

    Raises:
        CellError: a field of the file is refused, or home violates the limits or the surroundings.
    """
    cell = load_cell(path)
    check_home(cell)
    return cell


def default_cells_folder() -> Path:
    """Returns the first folder with cell files: `cells` here, in the checkout, or of the installed package."""
    packages = Path(__file__).parent.parent
    checkout = packages / "cells"
    candidates = (Path("cells"), checkout, packages / "fling" / "cells")
    return next((folder for folder in candidates if any(folder.glob("*.toml"))), checkout).resolve()


def check_home(cell: Cell) -> None:
    """Certifies a standstill at home.

    Raises:
        CellError: home violates a limit or the surroundings; the reason names the check, its value and its limit.
    """
    for fault in home_faults(cell):
        raise fault


def home_faults(cell: Cell) -> list[CellError]:
    """Returns what a standstill at home violates, a fault for each check."""
    rest = np.tile(cell.home, (2, 1))
    zero = np.zeros((2, 6))
    problem = ThrowProblem(cell, cell.home, JointRelease(cell.home, np.zeros(6)), cell.limits)
    standing = Trajectory(cell.robot.sample_rate_hz, rest, zero, zero, release_index=1)
    found = []
    for check in certify(problem, standing).failures:
        what = f" ({check.detail})" if check.detail else ""
        reason = f"violates {check.name}: {check.value:.4g} against {check.limit:.4g} {check.unit}{what}"
        found.append(CellError("home_rad", cell.home.tolist(), reason))
    return found


def file_faults(path: Path | str) -> list[CellError]:
    """Returns every fault of a cell file, those of its home where its keys have none; empty for a good cell."""
    try:
        source = read_source(path)
    except CellError as error:
        return [error]
    return cell_faults(source) or home_faults(cell_of(source))
