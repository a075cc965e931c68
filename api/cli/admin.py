"""Administration commands: cell, token, db, version."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.cell_versions import diff, history, restore
from api.cli.support.cell_warnings import warnings_of
from api.cli.support.errors import FlingGroup
from api.cli.support.options import cell_option, json_option
from api.cli.support.terminal import BAD, GOOD, say

if TYPE_CHECKING:
    from planner.cell import Cell


@click.group(cls=FlingGroup)
def cell() -> None:
    """Check cell files, and import what belongs to them."""


for command in (history, diff, restore):
    cell.add_command(command)


@cell.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@json_option
def check(file: Path, as_json: bool) -> None:
    """Check FILE as the service and the executor do, and name every fault at once; exit status 1 if there is one."""
    from planner.cell import load_cell
    from planner.cell_folder import file_faults

    faults = file_faults(file)
    if faults:
        raise CellRefused(file, [{"field": f.field, "value": f.value, "reason": f.reason} for f in faults], faults)
    found = load_cell(file)
    if as_json:
        summary = {"cell": found.name, "robot": found.robot.name, "link": found.link.kind, "host": found.link.host}
        notes = {"kinematics": _kinematics_of(found), "warnings": warnings_of(found)}
        click.echo(json.dumps({**summary, "sha256": found.sha256, **notes}))
        return
    kind = "a simulated controller" if found.link.kind == "sim" else "a REAL arm"
    say(f"{file}: good. {found.robot.name}, {kind} at {found.link.host}, sha256 {found.sha256}", GOOD)
    click.echo(_kinematics_of(found))
    for warning in warnings_of(found):
        say(warning, BAD)


class CellRefused(click.ClickException):
    """A cell file has faults; `problem` lists them."""

    def __init__(self, file: Path, errors: list[dict[str, Any]], faults: Sequence[object]) -> None:
        count = "a fault" if len(faults) == 1 else f"{len(faults)} faults"
        super().__init__("\n  ".join([f"{file} has {count}:", *map(str, faults)]))
        self.problem = {"title": "Cell refused", "detail": f"{file} has {count}", "errors": errors}


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
    from store import Store, StoreError, default_database_url

    try:
        before, after = Store.upgrade(database_url or default_database_url())
    except (StoreError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error
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
