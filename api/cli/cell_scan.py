"""The command that adds what a camera has seen to a cell file."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from api.cli.cell_import import cell_to_extend, extend
from api.cli.support.options import json_option, pose_option
from api.cli.support.terminal import BAD, GOOD, say

if TYPE_CHECKING:
    from planner.cell import Cell
    from planner.scenes import Scan

DEFAULT_CELL_M = 0.02  # an object or a tool is mostly no smaller
DEFAULT_WITHIN_M = 3.0  # about twice the reach of a UR10e


@click.command("scan")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--into", "name", required=True, metavar="CELL", help="Cell file, or name of a cell.")
@click.option(
    "--camera", nargs=6, type=float, default=(0.0,) * 6, help="Its pose in the world: x y z [m], rx ry rz [rad]."
)
@click.option("--intrinsics", nargs=4, type=float, help="fx fy cx cy [pixel] of a depth picture's camera.")
@click.option(
    "--scale", type=click.FloatRange(1e-6, 1e3), help="Metres of a unit; default: 1, of depth pictures 0.001."
)
@click.option(
    "--cell-size",
    "cell_m",
    type=click.FloatRange(0.001, 1.0),
    default=DEFAULT_CELL_M,
    show_default=True,
    help="Of the grid [m].",
)
@click.option(
    "--within",
    "within_m",
    type=click.FloatRange(0.1, 100.0),
    default=DEFAULT_WITHIN_M,
    show_default=True,
    help="Distance from the arm's base [m].",
)
@json_option
def scan(
    file: Path,
    name: str,
    camera: tuple[float, ...],
    intrinsics: tuple[float, ...] | None,
    scale: float | None,
    cell_m: float,
    within_m: float,
    as_json: bool,
) -> None:
    """Add what a camera has seen in FILE to the cell CELL: the full cells of a grid, as boxes.

    FILE is a point cloud (.ply, .xyz, .pcd) or a depth picture (PNG of 16 bits). What is nearer to the arm and its tool
    at home than the clearance is taken for these, and what is lower than a cell of the grid for the floor. A second
    scan from a file of that name takes the place of the first.
    """
    import numpy as np

    from planner.scenes import MILLIMETRE, points_ply, read_points, scanned

    X_WC = pose_option(camera, "--camera")
    if scale is not None and not np.isfinite(scale):
        raise click.BadParameter("must be a number", param_hint="--scale")
    if intrinsics is not None and not (np.isfinite(intrinsics).all() and min(intrinsics[:2]) > 0.0):
        raise click.BadParameter("focal lengths must be above 0", param_hint="--intrinsics")
    path, text, cell = cell_to_extend(name)
    unit = scale if scale is not None else (MILLIMETRE if file.suffix.lower() == ".png" else 1.0)
    points = unit * read_points(file, intrinsics) @ X_WC[:3, :3].T + X_WC[:3, 3]
    made = scanned(cell, points, cell_m, within_m)
    if not len(made.middles):
        raise click.ClickException(f"{file}: nothing is left of it: {'; '.join(made.left_out)}")
    place = path.with_name(f"{path.stem}-scan-{re.sub(r'[^A-Za-z0-9_-]+', '-', file.stem)[:40]}.ply")
    extend(path, _named(text, cell, place.name, cell_m, file), {place: points_ply(made.middles)}, file)
    _tell(path, place, len(points), made, as_json)


def _named(text: str, cell: Cell, place: str, cell_m: float, file: Path) -> str:
    """Returns the text of a cell file that names a file of points; the same where it does.

    Raises:
        ClickException: it names that with cells of another size.
    """
    import numpy as np

    from planner.scenes import ForeignShape, entries_of, with_entries

    for entry in cell.document["surroundings"]["keep_out"]:
        if entry.get("file") == place:
            if entry.get("cell_m") != cell_m:
                raise click.ClickException(
                    f"{place} is named with cell_m = {entry.get('cell_m')}: take the entry out first"
                )
            return text
    shape = ForeignShape(f"scan {file.stem}", "points", np.eye(4), {"cell_m": cell_m})
    return with_entries(text, entries_of([shape], [place], cell.surroundings.keep_out_names), file.name)


def _tell(path: Path, place: Path, count: int, made: Scan, as_json: bool) -> None:
    from planner.cell import cover_in, cover_key, load_cell

    cell = load_cell(path)
    entry = next(each for each in cell.document["surroundings"]["keep_out"] if each.get("file") == place.name)
    known = cover_in(cell.meshes, cover_key(entry) or "")
    assert not isinstance(known, str)
    cover, _ = known
    boxes = len(cover.lower)
    if as_json:
        told = {"cell": path.stem, "file": place.name, "cells": len(made.middles), "boxes": boxes}
        click.echo(json.dumps({**told, "beyond_m": cover.beyond, "left_out": made.left_out}))
        return
    what = f"{count} points in {len(made.middles)} cells, as {boxes} boxes of {place.name}"
    say(f"{path}: {what}, at most {1e3 * cover.beyond:.3g} mm beyond them", GOOD)
    for each in made.left_out:
        say(f"left out: {each}", BAD)
