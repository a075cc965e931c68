"""A plan in a file, as `fling plan` and GET /plans/{id} write it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.documents import read_text

if TYPE_CHECKING:
    from planner.cell import Cell

PLAN_BYTES = 50_000_000  # [byte] of a plan; one of a second has 300,000
# Keys of a plan that a report needs; a list of plans leaves out the trajectory.
NEEDED = ("trajectory", "certificate", "flight", "release", "request", "solver", "cell", "cell_sha256", "id")


def plan_in(file: Path) -> dict[str, Any]:
    """Returns the plan in a file, with all keys of `NEEDED`.

    Raises:
        click.ClickException: there is none, and why, in words.
    """
    text = read_text(file, PLAN_BYTES)
    try:
        plan = json.loads(text)
    except (ValueError, RecursionError) as error:
        why = f"it is not JSON ({error})" if text else "it is empty"
        raise click.ClickException(f"{file} is not a plan: {why}") from error
    if not isinstance(plan, dict):
        raise click.ClickException(f"{file} is not a plan: it has another form")
    if "title" in plan:
        raise click.ClickException(
            f"{file} is not a plan: it is the answer to a request that was refused: {plan['title']}"
        )
    for key in NEEDED:
        if key not in plan:
            raise click.ClickException(f"{file} is not a plan: it lacks {key!r}")
    return plan


def cell_of_plan(plan: dict[str, Any], cells: Path | None) -> Cell:
    """Returns the cell of a plan, from a folder or that of the settings.

    Raises:
        click.ClickException: there is none, or another version of it.
    """
    from api.cell_repository import CellRepository
    from api.settings import parse_settings

    folder = cells or parse_settings().cells
    cell = CellRepository(folder).cell(plan["cell"])
    if cell is None:
        raise click.ClickException(f"there is no cell {plan['cell']!r} in {folder}")
    if cell.sha256 != plan["cell_sha256"]:
        raise click.ClickException(f"the plan is for another version of cell {cell.name!r}: plan it again")
    return cell
