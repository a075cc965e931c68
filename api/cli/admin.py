"""Administration commands: cell, token, db, version."""

from __future__ import annotations

import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from planner.cell import Cell


@click.group()
def cell() -> None:
    """Check cell files, and import what belongs to them."""


@cell.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
def check(file: Path) -> None:
    """Check FILE as the service and the executor do; exit status 1 with the reason if it is refused."""
    from planner.cell_folder import open_cell
    from planner.errors import CellError

    try:
        found = open_cell(file)
    except CellError as error:
        raise click.ClickException(f"{file}: {error}") from error
    kind = "a simulated controller" if found.link.kind == "sim" else "a REAL arm"
    click.echo(f"{file}: good. {found.robot.name}, {kind} at {found.link.host}, sha256 {found.sha256}")
    click.echo(_kinematics_of(found))


def _kinematics_of(cell: Cell) -> str:
    """Returns which kinematics a cell's arm has."""
    from planner.kinematics import chain_difference

    if cell.calibration is None:
        reads = "`fling cell kinematics --from-robot` reads the arm's own"
        return "kinematics: the published table, from which arms are up to a centimetre off" + (
            f"; {reads}" if cell.link.kind == "ur" else ""
        )
    apart = chain_difference(cell.robot.published, cell.robot)
    size = f"{apart.median_m * 1e3:.2f} mm in the median of postures, up to {apart.largest_m * 1e3:.2f} mm"
    return f"kinematics: {cell.calibration.name} ({cell.calibration.hash or 'no hash'}), {size} off the published table"


@cell.command()
@click.option("--cell", "name", help="Cell; default: FLING_DEFAULT_CELL.")
@click.option("--from-robot", is_flag=True, required=True, help="Read them from the cell's controller.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def kinematics(name: str | None, from_robot: bool, as_json: bool) -> None:
    """Write the measured kinematics of the cell's arm beside its cell file, as UR's ROS driver does.

    Exit status 1 if the controller does not answer, or its arm is of another model.
    """
    arguments = [*(["--cell", name] if name else []), *(["--json"] if as_json else [])]
    os.execv(sys.executable, [sys.executable, "-m", "executor", "--kinematics", *arguments])


tokens_file = click.option(
    "--file",
    type=click.Path(path_type=Path),
    envvar="FLING_TOKENS_FILE",
    required=True,
    help="Tokens file; FLING_TOKENS_FILE.",
)


@click.group()
def token() -> None:
    """Create, list and revoke tokens for the service."""


@token.command()
@click.option("--scope", "scopes", multiple=True, required=True, type=click.Choice(["plan", "operate"]))
@click.option("--name", required=True, help="Owner of the token, as the audit trail shows it.")
@tokens_file
@click.option("--days", type=click.FloatRange(min=0.0, min_open=True), help="Days until it expires; default: never.")
def create(scopes: tuple[str, ...], name: str, file: Path, days: float | None) -> None:
    """Create a token and print it; the file keeps only its hash. A running service knows it at once."""
    from api.http import create_token

    ends = None if days is None else datetime.now(UTC).replace(microsecond=0) + timedelta(days=days)
    try:
        click.echo(create_token(file, name, scopes, ends))
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error


@token.command("list")
@tokens_file
def list_tokens(file: Path) -> None:
    """List the tokens of the file: name, scopes, and when each expires."""
    from api.http import read_tokens

    try:
        tokens = read_tokens(file)
    except ValueError as error:
        raise click.ClickException(str(error)) from error
    for stored in tokens:
        ends = "never" if stored.expires_at is None else stored.expires_at.isoformat()
        state = " (has expired)" if stored.has_expired else ""
        click.echo(f"{stored.caller.name}: {', '.join(sorted(stored.caller.scopes))}; expires {ends}{state}")


@token.command()
@click.argument("name")
@tokens_file
def revoke(name: str, file: Path) -> None:
    """Revoke the token called NAME: the service refuses it from its next request on."""
    from api.http import revoke_token

    try:
        revoke_token(file, name)
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error


@click.group()
def db() -> None:
    """Migrate the database."""


@db.command()
@click.option(
    "--database-url", envvar="FLING_DATABASE_URL", help="FLING_DATABASE_URL; default: the user's SQLite file."
)
def upgrade(database_url: str | None) -> None:
    """Bring the database up to date."""
    from store import Store, StoreError, default_database_url

    try:
        before, after = Store.upgrade(database_url or default_database_url())
    except (StoreError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"version {after}" + (", as before" if before == after else f", from {before}"))


@click.command()
def version() -> None:
    """Show the version."""
    from api import fling_version

    click.echo(f"fling {fling_version()}")
