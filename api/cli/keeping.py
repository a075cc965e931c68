"""Commands that look after files and the database: cell, token, db, version."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def cell() -> None:
    """Judge cell files."""


@cell.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
def check(file: Path) -> None:
    """Judge FILE as the service and the executor would; exit status 1 with the reason where it is refused."""
    from planner.cell_folder import open_cell
    from planner.errors import CellError

    try:
        found = open_cell(file)
    except CellError as error:
        raise click.ClickException(f"{file}: {error}") from error
    kind = "a simulated controller" if found.link.kind == "sim" else "a REAL arm"
    click.echo(f"{file}: good. {found.robot.name}, {kind} at {found.link.host}, sha256 {found.sha256}")


@click.group()
def token() -> None:
    """Make tokens for the service."""


@token.command()
@click.option("--scope", "scopes", multiple=True, required=True, type=click.Choice(["plan", "operate"]))
@click.option("--name", required=True, help="Whose it is; the audit trail shows it.")
@click.option("--file", type=click.Path(path_type=Path), envvar="FLING_TOKENS_FILE", required=True,
              help="Tokens file; FLING_TOKENS_FILE.")  # fmt: skip
def create(scopes: tuple[str, ...], name: str, file: Path) -> None:
    """Make a token and print it; the file keeps its hash alone. Restart the service to use it."""
    from api.tokens import create_token

    try:
        click.echo(create_token(file, name, scopes))
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error


@click.group()
def db() -> None:
    """Migrations of the database."""


@db.command()
@click.option("--database-url", envvar="FLING_DATABASE_URL", help="FLING_DATABASE_URL; the user's SQLite otherwise.")
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
    from api.version import fling_version

    click.echo(f"fling {fling_version()}")
