"""Administration commands: cell, token, db, version."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from api.cli.cell_versions import diff, history, restore

if TYPE_CHECKING:
    from planner.cell import Cell


@click.group()
def cell() -> None:
    """Check cell files, and import what belongs to them."""


for command in (history, diff, restore):
    cell.add_command(command)


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


@click.group()
def token() -> None:
    """Create tokens for the service."""


@token.command()
@click.option("--scope", "scopes", multiple=True, required=True, type=click.Choice(["plan", "operate"]))
@click.option("--name", required=True, help="Owner of the token, as the audit trail shows it.")
@click.option(
    "--file",
    type=click.Path(path_type=Path),
    envvar="FLING_TOKENS_FILE",
    required=True,
    help="Tokens file; FLING_TOKENS_FILE.",
)
def create(scopes: tuple[str, ...], name: str, file: Path) -> None:
    """Create a token and print it; the file keeps only its hash. Restart the service to use it."""
    from api.http import create_token

    try:
        click.echo(create_token(file, name, scopes))
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
