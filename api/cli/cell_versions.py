"""Commands on the versions of a cell file: history, diff, restore."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.options import cell_option, json_option

if TYPE_CHECKING:
    from store import CellVersionRow

CELL = cell_option("name")


@click.command()
@CELL
@json_option
def history(name: str | None, as_json: bool) -> None:
    """List the versions of a cell file that service or executor have seen, with what changed."""
    from api.cell_history import history_document

    path, versions = _versions(name)
    document = history_document(path.stem, versions)
    if as_json:
        click.echo(json.dumps(document, indent=2))
        return
    for version in document["versions"]:
        click.echo(f"{version['version']:>4}  {version['seen_at']}  {version['sha256'][:12]}  {version['seen_by']}")
        for change in version["changes"]:
            click.echo(f"      {change['key']}: {_value(change['before'])} -> {_value(change['after'])}")


@click.command()
@click.argument("before", type=int)
@click.argument("after", type=int, required=False)
@CELL
@json_option
def diff(before: int, after: int | None, name: str | None, as_json: bool) -> None:
    """Show the difference from version BEFORE to version AFTER, or to the file as it is now."""
    from api.cell_history import changed_keys, text_diff

    path, versions = _versions(name)
    old = _find(versions, before)
    new = _present(path) if after is None else _find(versions, after)
    text = text_diff(old, new)
    if as_json:  # `after` is null for the file as it is now
        document = {"cell": path.stem, "before": before, "after": after, "changes": changed_keys(old, new)}
        text = f"{json.dumps({**document, 'diff': text})}\n"
    click.echo(text, nl=False)


@click.command()
@click.argument("version", type=int)
@CELL
@json_option
def restore(version: int, name: str | None, as_json: bool) -> None:
    """Write version VERSION back to the cell file, and to its calibration file.

    The present file is a version too; where it is refused, it is kept as NAME.toml.refused. Service and executor take
    the restored file over between executions; plans of other versions have to be made again.
    """
    from planner.cell import read_source

    path, versions = _versions(name)
    row = _find(versions, version)
    files = [path]
    if versions[0].sha256 != _present(path).sha256:  # refused as it is, so in no version
        path.with_name(f"{path.name}.refused").write_bytes(path.read_bytes())
    if row.calibration is not None:
        files.append(_calibration_of(path, row))
        _write(files[1], row.calibration)
    _write(path, row.text)
    is_other = read_source(path).sha256 != row.sha256
    notes = [f"a mesh file beside it is not as it was: put back that of version {version}"] if is_other else []
    if as_json:
        document = {"cell": path.stem, "version": version, "files": [str(file) for file in files], "notes": notes}
        click.echo(json.dumps(document))
        return
    click.echo(f"{path}: version {version}" + "".join(f", with {file.name}" for file in files[1:]))
    for note in notes:
        click.echo(note)


def _versions(name: str | None) -> tuple[Path, list[CellVersionRow]]:
    """Returns the path of the cell file and its versions; the present file is one, unless it is refused."""
    from api.cell_repository import CellRepository
    from api.cli.support.processes import cell_path
    from api.settings import parse_settings
    from planner.errors import CellError
    from store import Store

    settings = parse_settings()
    path = cell_path(settings.cells, name or settings.default_cell)
    store = Store.open(settings.database_url)
    try:
        CellRepository(settings.cells).cell(path.stem)
        now = _present(path)
        store.note_cell_version(now.cell, now.sha256, now.text, now.calibration, "command line", now.meshes)
    except CellError as error:
        click.echo(f"the file is refused as it is: {error}", err=True)
    try:
        found = store.cell_versions(path.stem)
    finally:
        store.close()
    if not found:
        raise click.ClickException(f"no version of {path} is known yet")
    return path, found


def _present(path: Path) -> CellVersionRow:
    """Returns the files as they are now, as version 0."""
    from planner.cell import read_source
    from store import CellVersionRow

    source = read_source(path)
    return CellVersionRow(source.name, 0, source.sha256, source.text, source.calibration, 0.0, "", source.meshes)


def _find(versions: list[CellVersionRow], number: int) -> CellVersionRow:
    for row in versions:
        if row.version == number:
            return row
    raise click.ClickException(f"there is no version {number}; there are 1 to {versions[0].version}")


def _calibration_of(path: Path, row: CellVersionRow) -> Path:
    """Returns the path of the calibration file that a version names."""
    from planner.documents import parse_toml

    return path.with_name(parse_toml(row.text)["kinematics"]["calibration"])


def _write(path: Path, content: bytes) -> None:
    """Replaces a file at once: nobody reads half of it."""
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)


def _value(value: Any) -> str:
    return "(left out)" if value is None else json.dumps(value)
