"""The command that adds the shapes of another program's scene to a cell file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.options import json_option, pose_option
from api.cli.support.terminal import BAD, GOOD, say

if TYPE_CHECKING:
    from planner.arrays import Array
    from planner.cell import Cell
    from planner.scenes import ForeignScene, ForeignShape

SAME_PLACE = 1e-3  # [m, -] by which the bases of two arms may differ


@click.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--into", "name", required=True, metavar="CELL", help="Cell file, or name of a cell.")
@click.option(
    "--at",
    "place",
    nargs=6,
    type=float,
    default=(0.0,) * 6,
    help="Pose of its frame in the cell's world: x y z [m], rx ry rz [rad]. Default: the same frame.",
)
@json_option
def import_scene(file: Path, name: str, place: tuple[float, ...], as_json: bool) -> None:
    """Add the shapes of FILE to the cell CELL, and name what was left out.

    FILE is a URDF, SDF or MJCF file, or a scene of MoveIt: its text (.scene), or a planning scene as YAML. A model that
    has a frame of its own, as a table has, is put in its place with --at. Meshes are copied beside the cell file. What
    the cell has already is not added again.
    """
    from planner.scenes import entries_of, not_there, with_entries

    scene = _placed(_scene(file), pose_option(place, "--at"))
    path, text, cell = cell_to_extend(name)
    on_base = _notes_on_base(scene, cell)
    tables = cell.document["surroundings"]["keep_out"]
    shapes, there = not_there(scene.shapes, tables, _meshes_beside(path, tables))
    files, contents = mesh_files(path, shapes)
    entries = entries_of(shapes, files, cell.surroundings.keep_out_names)
    extend(path, with_entries(text, entries, file.name) if entries else text, contents, file, on_base)
    notes = [*scene.notes, *on_base]
    left_out = list(dict.fromkeys(scene.left_out))
    if as_json:
        names = [json.loads(entry["name"]) for entry in entries]
        told = {"cell": path.stem, "shapes": names, "there_already": there, "left_out": left_out, "notes": notes}
        click.echo(json.dumps(told))
        return
    say(f"{path}: {len(entries)} shapes of {file}", GOOD)
    already = [f"there already, the same: {each}" for each in there]
    for line in [*already, *(f"left out: {each}" for each in left_out), *notes]:
        say(line, BAD)


def cell_to_extend(name: str) -> tuple[Path, str, Cell]:
    """Returns the path of a cell file, its text and the cell, which shapes are added to.

    Raises:
        ClickException: it is refused, or came with Fling.
    """
    from api.cli.support.processes import cell_path
    from api.settings import parse_settings
    from planner.cell import cell_of, source_of
    from planner.cell_folder import is_shipped
    from planner.errors import CellError

    path = Path(name) if name.endswith(".toml") else cell_path(parse_settings().cells, name)
    if is_shipped(path):
        raise click.ClickException(f"{path} came with Fling: copy it to ./cells first, or see `fling cell new`")
    try:
        text = path.read_text()
        return path, text, cell_of(source_of(path, text.encode()))
    except (OSError, UnicodeDecodeError, CellError) as error:
        raise click.ClickException(f"{path}: {error}") from error


def extend(path: Path, text: str, contents: Mapping[Path, bytes], file: Path, notes: Sequence[str] = ()) -> None:
    """Writes a cell file and what is beside it, where the cell is not refused with that.

    Args:
        path: of the cell file.
        text: of it.
        contents: of files beside it.
        file: that the shapes come from.
        notes: which may say why it is refused.

    Raises:
        ClickException: the cell is refused; all files are as before.
    """
    from planner.cell import cell_of, source_of
    from planner.cell_folder import checked
    from planner.errors import CellError

    before = {place: place.read_bytes() for place in contents if place.exists()}
    for place, content in contents.items():
        place.write_bytes(content)
    try:
        checked(cell_of(source_of(path, text.encode())))
    except CellError as error:
        for place in contents:
            place.write_bytes(before[place]) if place in before else place.unlink()
        why = "; ".join([str(error), *notes])
        raise click.ClickException(f"{path} would be refused with the shapes of {file}: {why}") from error
    part = path.with_name(f".{path.name}.part")
    part.write_text(text)
    part.replace(path)


def _meshes_beside(path: Path, tables: Sequence[Mapping[str, Any]]) -> dict[str, bytes]:
    """Returns the contents of the files that shapes of a cell file name."""
    names = {table["file"] for table in tables if "file" in table}
    return {name: path.with_name(name).read_bytes() for name in names}


def _scene(file: Path) -> ForeignScene:
    """Returns the shapes of a file.

    Raises:
        FileRefused: it is none that can be read.
    """
    from planner.scenes import read_scene
    from planner.urdf import scene_of_urdf

    if file.suffix.lower() == ".srdf":
        raise click.ClickException(f"{file}: an SRDF has no shapes; the URDF that it goes with has them")
    return scene_of_urdf(file) if file.suffix.lower() == ".urdf" else read_scene(file)


def _placed(scene: ForeignScene, X_WS: Array) -> ForeignScene:
    """Returns a scene whose frame has a pose in the world (4, 4), in the world's frame."""
    shapes = [replace(shape, X=X_WS @ shape.X) for shape in scene.shapes]
    return replace(scene, shapes=shapes, X_WB=None if scene.X_WB is None else X_WS @ scene.X_WB)


def _notes_on_base(scene: ForeignScene, cell: Cell) -> list[str]:
    """Returns a note where the file's arm stands elsewhere than the cell's, and so what is around it."""
    from planner.rotations import matrix_to_rotation_vector

    if scene.X_WB is None or abs(scene.X_WB - cell.X_WB).max() < SAME_PLACE:
        return []
    place = (scene.X_WB[:3, 3].round(4) + 0.0).tolist()  # no -0.0
    turn = (matrix_to_rotation_vector(scene.X_WB[:3, :3]).round(4) + 0.0).tolist()
    return [
        "the file's arm stands elsewhere in its world than the cell's: for the same places around it,"
        f" base_in_world is position_m = {place}, rotation_vector_rad = {turn}"
    ]


def mesh_files(path: Path, shapes: Sequence[ForeignShape]) -> tuple[list[str], dict[Path, bytes]]:
    """Returns the name of each shape's mesh file beside a cell file, empty without one, and what is to be written.

    A mesh that several shapes have is written once; none is written over another file.
    """
    names: dict[tuple[bytes, str], str] = {}
    contents = {}
    for shape in shapes:
        if shape.mesh is not None and shape.mesh not in names:
            plain = f"{path.stem}-{re.sub(r'[^A-Za-z0-9_-]+', '-', shape.name)[:40]}"
            number = 1
            place = path.with_name(f"{plain}.{shape.mesh[1]}")
            while place.exists() or place in contents:
                number += 1
                place = path.with_name(f"{plain}-{number}.{shape.mesh[1]}")
            contents[place] = shape.mesh[0]
            names[shape.mesh] = place.name
    return ["" if shape.mesh is None else names[shape.mesh] for shape in shapes], contents
