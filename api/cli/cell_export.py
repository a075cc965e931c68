"""The command that writes a cell as other programs read it."""

from __future__ import annotations

import json

import click

from api.cli.support.options import cell_option, json_option


@click.command("export")
@cell_option("name")
@click.option("--urdf", "kind", flag_value="urdf", help="As URDF.")
@click.option("--mjcf", "kind", flag_value="mjcf", help="As MJCF, for MuJoCo.")
@json_option
def export_cell(name: str | None, kind: str | None, as_json: bool) -> None:
    """Write the cell to standard output: arm, tool and what stands around them, as URDF or MJCF.

    With --json it is the `text` of a document.
    """
    from api.cli.support.processes import cell_path
    from api.settings import parse_settings
    from planner.cell import load_cell
    from planner.scenes import mjcf_of, urdf_of

    if kind is None:
        raise click.UsageError("say --urdf or --mjcf")
    settings = parse_settings()
    cell = load_cell(cell_path(settings.cells, name or settings.default_cell))
    text = urdf_of(cell) if kind == "urdf" else mjcf_of(cell)
    if as_json:
        text = f"{json.dumps({'cell': cell.name, 'sha256': cell.sha256, 'format': kind, 'text': text})}\n"
    click.echo(text, nl=False)
