"""The command that writes a cell file from a URDF file."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import click

from api.cli.support.cell_warnings import warnings_of
from api.cli.support.options import json_option
from api.cli.support.terminal import BAD, GOOD, say


@click.command("from-urdf")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Cell file to write; default: FILE's name, .toml, here.")
@click.option("--robot", "model", help="Model of the arm; default: the one whose kinematics are closest.")
@click.option("--tcp", help="Link whose origin is the tool centre point; default: the end of the tool, if it has one.")
@json_option
def from_urdf(file: Path, out: Path | None, model: str | None, tcp: str | None, as_json: bool) -> None:
    """Write a cell file for the arm in the URDF file FILE: base, tool, limits, masses, a measured chain.

    The cell is a simulated one; [link] takes the address of a real controller. Nothing is written over.
    """
    from planner.cell_folder import home_faults
    from planner.urdf import cell_from_urdf

    out = out or Path(re.sub(r"[^A-Za-z0-9_-]+", "-", file.stem).strip("-") + ".toml")
    if not out.parent.is_dir():
        raise click.ClickException(f"{out} cannot be written: there is no folder {out.parent}")
    written = cell_from_urdf(file, out.stem, model, tcp)
    files = {out: written.text}
    if written.calibration is not None:
        calibration, text = written.calibration
        files = {out.with_name(calibration): text, **files}
    write_new(files)
    paths = [*files][::-1]
    notes = [*written.notes, *warnings_of(written.cell), *map(str, home_faults(written.cell))]
    if as_json:
        answer = {"cell": written.cell.name, "robot": written.cell.robot.name, "files": [str(path) for path in paths]}
        click.echo(json.dumps({**answer, "notes": notes}))
        return
    say(f"{' and '.join(map(str, paths))}: a {written.cell.robot.name}, simulated", GOOD)
    for note in notes:
        say(note, BAD)


def refuse_present(paths: Iterable[Path]) -> None:
    """Refuses to write over a file.

    Raises:
        click.ClickException: one is there already.
    """
    for path in paths:
        if path.exists():
            raise click.ClickException(f"{path} is there already: give another name")


def write_new(files: Mapping[Path, str]) -> None:
    """Writes files of which none is there yet: all of them, or none.

    Raises:
        click.ClickException: one is there already, or cannot be written.
    """
    refuse_present(files)
    made: list[Path] = []
    for path, text in files.items():
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            made.append(path)
            with open(descriptor, "w", encoding="utf-8") as stream:
                stream.write(text)
        except OSError as error:
            for written_path in made:
                written_path.unlink()
            raise click.ClickException(f"{path} cannot be written: {error.strerror}") from error
