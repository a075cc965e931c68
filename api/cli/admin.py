"""Administration commands: cell, token, db, version."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.cell_export import export_cell
from api.cli.cell_import import import_scene
from api.cli.cell_new import new
from api.cli.cell_scan import scan
from api.cli.cell_urdf import from_urdf
from api.cli.cell_versions import diff, history, restore
from api.cli.support.cell_warnings import warnings_of
from api.cli.support.errors import FlingGroup
from api.cli.support.options import cell_option, json_option
from api.cli.support.terminal import BAD, GOOD, say

if TYPE_CHECKING:
    from planner.cell import Cell
    from planner.errors import CellError


VALUE_MAX = 400  # characters of a refused value in JSON
MESH_LEAST_M = 0.005  # [m] size below which a mesh is rather one whose scale is wrong
MESH_MOST_M = 20.0  # [m] size beyond which it is, too: no cell is so large
MESH_BEYOND = 0.15  # [-] of its size beyond which its boxes reach: a ball's come to 0.12


@click.group(cls=FlingGroup)
def cell() -> None:
    """Write and check cell files, and import what belongs to them."""


for command in (new, history, diff, restore, from_urdf, import_scene, scan, export_cell):
    cell.add_command(command)


@cell.command()
@click.argument("files", metavar="FILE ...", nargs=-1, required=True, type=click.Path(path_type=Path))
@json_option
def check(files: tuple[Path, ...], as_json: bool) -> None:
    """Check each FILE as the service and the executor do, and name every fault at once; exit status 1 if there is one.

    With --json each good file is a line.
    """
    from planner.cell import load_cell
    from planner.cell_folder import file_faults

    refused = {}
    for file in files:
        if faults := file_faults(file):
            refused[file] = faults
        elif as_json:
            click.echo(json.dumps(_cell_document(load_cell(file))))
        else:
            _say_good(file, load_cell(file))
    if refused:
        raise CellRefused(refused)


def _say_good(file: Path, cell: Cell) -> None:
    kind = "a simulated controller" if cell.link.kind == "sim" else "a REAL arm"
    say(f"{file}: good. {cell.robot.name}, {kind} at {cell.link.host}, sha256 {cell.sha256}", GOOD)
    for line in (_kinematics_of(cell), *_tool_shapes_of(cell), *_meshes_of(cell)):
        click.echo(line)
    for warning in warnings_of(cell):
        say(warning, BAD)


def _cell_document(cell: Cell) -> dict[str, Any]:
    summary = {"cell": cell.name, "robot": cell.robot.name, "link": cell.link.kind, "host": cell.link.host}
    shapes = {"tool_shapes": _tool_shapes_of(cell), "meshes": _meshes_of(cell)}
    notes = {"kinematics": _kinematics_of(cell), **shapes, "warnings": warnings_of(cell)}
    return {**summary, "sha256": cell.sha256, **notes}


class CellRefused(click.ClickException):
    """Cell files have faults; `problem` lists them."""

    def __init__(self, refused: Mapping[Path, Sequence[CellError]]) -> None:
        heads = {file: f"{file} has {_count(faults)}" for file, faults in refused.items()}
        texts = ["\n  ".join([f"{heads[file]}:", *map(str, faults)]) for file, faults in refused.items()]
        super().__init__("\n".join(texts))
        errors = [_fault_document(file, fault) for file, faults in refused.items() for fault in faults]
        self.problem = {"title": "Cell refused", "detail": "; ".join(heads.values()), "errors": errors}


def _count(faults: Sequence[object]) -> str:
    return "a fault" if len(faults) == 1 else f"{len(faults)} faults"


def _fault_document(file: Path, fault: CellError) -> dict[str, Any]:
    return {"file": str(file), "field": fault.field, "value": _json_value(fault.value), "reason": fault.reason}


def _json_value(value: object) -> object:
    """Returns a value as it is; one that has no short form in JSON, such as a date, as a sentence quotes it."""
    from planner.errors import quoted

    try:
        is_short = len(json.dumps(value)) <= VALUE_MAX
    except (TypeError, ValueError, RecursionError):
        is_short = False
    return value if is_short else quoted(value)


def _kinematics_of(cell: Cell) -> str:
    """Returns which kinematics a cell's arm has."""
    from planner.kinematics import chain_difference

    if cell.calibration is None:
        reads = "`fling cell kinematics --from-robot` reads the arm's own"
        return "kinematics: the published table, from which arms are up to a centimetre off" + (
            f"; {reads}" if cell.link.kind == "ur" else ""
        )
    apart = chain_difference(cell.robot.published, cell.robot)
    named = f"{cell.calibration.name} ({cell.calibration.hash or 'no hash'})"
    return f"kinematics: {named}, {apart.words(2)} off the published table"


def _tool_shapes_of(cell: Cell) -> list[str]:
    """Returns as what each shape of a cell's tool is kept off, in words."""
    from planner.cell import tool_shapes

    first = len(cell.document["tool"]["capsules"])
    found = []
    for i, shape in enumerate(tool_shapes(cell.document["tool"], cell.meshes)):
        last = first + len(shape.capsules) - 1
        called = f"tool_{first}" if last == first else f"tool_{first} to tool_{last}"
        beyond = f", up to {1e3 * shape.beyond_m:.3g} mm beyond it" if shape.beyond_m > 0.0 else ""
        found.append(f"tool.shapes[{i}]: a {shape.kind}, as {called}{beyond}")
        first = last + 1
    return found


def _meshes_of(cell: Cell) -> list[str]:
    """Returns as what each mesh of a cell, and each cloud of points, counts, in words."""
    return [*_kept_out_meshes_of(cell), *_rooms_of(cell), *_object_mesh_of(cell)]


def _object_mesh_of(cell: Cell) -> list[str]:
    """Returns as what the mesh of a cell's object counts, in words."""
    from planner.cell import enclosed_object

    table = cell.document["object"]
    made = enclosed_object(table, cell.meshes)
    if made is None:
        return []
    size = " × ".join(f"{each:.3g}" for each in made.size_m)
    middle, along = (", ".join(f"{each:.3g}" for each in column) for column in (made.X_MO[:3, 3], made.X_MO[:3, 2]))
    ratio = "" if made.volume_ratio is None else f" and {made.volume_ratio:.3g} times its volume"
    told = (
        f"object: {table['file']}, as a {made.kind} of {size} m, at most {1e3 * made.beyond_m:.3g} mm beyond it{ratio}"
    )
    place = f"; in the file's axes its centre is at ({middle}) m"
    return [f"{told}{place}" + ("" if made.kind == "sphere" else f" and its z axis along ({along})")]


def _rooms_of(cell: Cell) -> list[str]:
    """Returns as what each mesh counts in which a cell's tool stays, in words."""
    from planner.cell import WALLED, cover_key, walls_in

    found = []
    for i, entry in enumerate(cell.document["surroundings"]["keep_in"]):
        known = walls_in(cell.meshes, key) if (key := cover_key(entry, WALLED)) is not None else "no mesh"
        if not isinstance(known, str):
            boxes = f"what {len(known)} boxes have in common" if len(known) > 1 else "a box"
            found.append(f"{entry.get('name') or f'mesh {i}'}: {entry['file']}, to stay in, as {boxes}")
    return found


def _kept_out_meshes_of(cell: Cell) -> list[str]:
    """Returns as what each mesh of a cell, and each cloud of points, is kept out, in words."""
    from planner.cell import cover_in, cover_key

    found = []
    for i, entry in enumerate(cell.document["surroundings"]["keep_out"]):
        key = cover_key(entry)
        known = cover_in(cell.meshes, key) if key is not None else "no mesh"
        if not isinstance(known, str):
            made, is_closed = known
            scale = entry.get("scale", 1.0)
            size_m = scale * (made.upper.max(axis=0) - made.lower.min(axis=0))
            beyond_m = scale * made.beyond
            boxes = f"{len(made.lower)} boxes" if len(made.lower) > 1 else "a box"
            size = " × ".join(f"{each:.3g}" for each in size_m)
            is_mesh = entry["shape"] == "mesh"
            name = entry.get("name") or f"{entry['shape']} {i}"
            of = "it" if is_mesh else "its points"
            told = f"{name}: {entry['file']}, {size} m, as {boxes}, at most {1e3 * beyond_m:.3g} mm beyond {of}"
            doubts = _mesh_doubts(size_m.max(), beyond_m, is_closed) if is_mesh else []
            found.append("; ".join([told, *doubts]))
    return found


def _mesh_doubts(size_m: float, beyond_m: float, is_closed: bool) -> list[str]:
    """Returns what may be wrong with a mesh that is so large, and whose boxes reach so far beyond it [m]."""
    doubts = []
    if not MESH_LEAST_M <= size_m <= MESH_MOST_M:
        doubts.append("is its scale right? 0.001 is for millimetres")
    if beyond_m > MESH_BEYOND * size_m:
        doubts.append("its boxes fill what it leaves open: give its walls as boxes of their own")
    if not is_closed:
        doubts.append("its surface is not closed, so what is in it may count as free")
    return doubts


@cell.command()
@cell_option("name")
@click.option("--from-robot", is_flag=True, required=True, help="Read them from the cell's controller.")
@json_option
def kinematics(name: str | None, from_robot: bool, as_json: bool) -> None:
    """Write the measured kinematics of the cell's arm beside its cell file, as UR's ROS driver does.

    Exit status 1 if the controller does not answer, or its arm is of another model.
    """
    arguments = [*(["--cell", name] if name else []), *(["--json"] if as_json else [])]
    os.execv(sys.executable, [sys.executable, "-P", "-m", "executor", "--kinematics", *arguments])


tokens_file = click.option(
    "--file",
    type=click.Path(path_type=Path),
    envvar="FLING_TOKENS_FILE",
    required=True,
    help="Tokens file; FLING_TOKENS_FILE.",
)


@click.group(cls=FlingGroup)
def token() -> None:
    """Create, list and revoke tokens for the service."""


@token.command()
@json_option
@click.option("--scope", "scopes", multiple=True, required=True, type=click.Choice(["plan", "operate"]))
@click.option("--name", required=True, help="Owner of the token, as the audit trail shows it.")
@tokens_file
@click.option("--days", type=click.FloatRange(min=0.0, min_open=True), help="Days until it expires; default: never.")
def create(scopes: tuple[str, ...], name: str, file: Path, days: float | None, as_json: bool) -> None:
    """Create a token and print it; the file keeps only its hash. A running service knows it at once."""
    from api.http import create_token

    ends = None if days is None else datetime.now(UTC).replace(microsecond=0) + timedelta(days=days)
    try:
        text = create_token(file, name, scopes, ends)
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error
    click.echo(json.dumps({"token": text, "name": name, "scopes": scopes}) if as_json else text)


@token.command("list")
@json_option
@tokens_file
def list_tokens(file: Path, as_json: bool) -> None:
    """List the tokens of the file: name, scopes, and when each expires."""
    from api.http import read_tokens

    try:
        tokens = read_tokens(file)
    except ValueError as error:
        raise click.ClickException(str(error)) from error
    rows = [
        {
            "name": stored.caller.name,
            "scopes": sorted(stored.caller.scopes),
            "expires_at": None if stored.expires_at is None else stored.expires_at.isoformat(),
            "expired": stored.has_expired,
        }
        for stored in tokens
    ]
    if as_json:
        click.echo(json.dumps(rows))
    for row in () if as_json else rows:
        state = " (has expired)" if row["expired"] else ""
        click.echo(f"{row['name']}: {', '.join(row['scopes'])}; expires {row['expires_at'] or 'never'}{state}")


@token.command()
@json_option
@click.argument("name")
@tokens_file
def revoke(name: str, file: Path, as_json: bool) -> None:
    """Revoke the token called NAME: the service refuses it from its next request on."""
    from api.http import revoke_token

    try:
        revoke_token(file, name)
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        click.echo(json.dumps({"revoked": name}))


@click.group(cls=FlingGroup)
def db() -> None:
    """Migrate the database."""


@db.command()
@click.option(
    "--database-url", envvar="FLING_DATABASE_URL", help="FLING_DATABASE_URL; default: the user's SQLite file."
)
@json_option
def upgrade(database_url: str | None, as_json: bool) -> None:
    """Bring the database up to date."""
    from fling import this_machine
    from store import Store

    before, after = Store.upgrade(database_url or this_machine.database_url(os.environ))
    if as_json:
        click.echo(json.dumps({"before": before, "after": after}))
        return
    click.echo(f"version {after}" + (", as before" if before == after else f", from {before}"))


@click.command()
@json_option
def version(as_json: bool) -> None:
    """Show the version."""
    from api import fling_version

    click.echo(json.dumps({"version": fling_version()}) if as_json else f"fling {fling_version()}")
