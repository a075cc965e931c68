"""Commands that start processes: up, serve, executor, doctor."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import NoReturn

import click


@click.command()
@click.option("--cell", help="Which cell; FLING_DEFAULT_CELL otherwise.")
@click.option("--port", type=int, help="Of the service; FLING_PORT, or 8000.")
def up(cell: str | None, port: int | None) -> None:
    """Simulated controller, executor, service, SQLite and web page on this machine. Ctrl-C stops all."""
    from api.cli.processes import ChildFailed, Children
    from api.cli.stack import start_stack
    from api.settings import Settings
    from planner.cell import load_cell
    from planner.errors import CellError
    from store import Store, StoreError

    settings = Settings()
    name, number = cell or settings.default_cell, port or settings.port
    try:
        simulated = load_cell(cell_path(settings.cells, name)).link.kind == "sim"
        Store.upgrade(settings.database_url)
    except (CellError, StoreError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error
    host = "127.0.0.1" if settings.host == "0.0.0.0" else settings.host
    url = f"http://{host}:{number}"
    environment = {
        "FLING_PORT": str(number), "FLING_CELLS": str(settings.cells), "FLING_DEFAULT_CELL": name,
        "FLING_DATABASE_URL": settings.database_url,
    }  # fmt: skip
    catch_signals()
    try:
        with Children(environment) as children:
            start_stack(children, settings.cells, name, url, simulated, say_starting)
            click.echo(f"\nFling is up: {url}    (OpenAPI: {url}/docs)")
            click.echo("try: fling throw 1.2 0.3 0.0\nCtrl-C stops all.")
            while True:
                time.sleep(0.5)
                children.check()
    except KeyboardInterrupt:
        click.echo("\nstopped.")
    except ChildFailed as error:
        raise click.ClickException(f"{error}; everything was stopped") from error


@click.command()
@click.option("--host", help="Address to listen on; FLING_HOST, or 127.0.0.1.")
@click.option("--port", type=int, help="FLING_PORT, or 8000.")
@click.option("--cells", type=click.Path(path_type=Path), help="Folder of cell files; FLING_CELLS.")
@click.option("--cell", "default_cell", help="The default cell; FLING_DEFAULT_CELL.")
@click.option("--database-url", help="FLING_DATABASE_URL; SQLite in the user's data folder otherwise.")
@click.option("--tokens-file", type=click.Path(path_type=Path), help="FLING_TOKENS_FILE.")
@click.option("--planner-workers", type=int, help="FLING_PLANNER_WORKERS.")
def serve(**flags: object) -> None:
    """The service alone: HTTP on one address, planner processes behind it."""
    from api.serving import serve as run
    from api.settings import Settings

    sys.exit(run(Settings(**{name: value for name, value in flags.items() if value is not None})))  # type: ignore[arg-type]


@click.command()
@click.option("--cell", help="Which cell; FLING_DEFAULT_CELL otherwise.")
@click.option("--read-only", is_flag=True, help="Connect, show state and preflight, never move.")
def executor(cell: str | None, read_only: bool) -> None:
    """The executor of one cell: claims executions and streams them to its controller."""
    _become("executor", *(["--cell", cell] if cell else []), *(["--read-only"] if read_only else []))


@click.command()
@click.option("--cell", help="Which cell; FLING_DEFAULT_CELL otherwise.")
def doctor(cell: str | None) -> None:
    """Judge this machine's timing and the link to the cell's controller, with advice."""
    _become("executor", "--doctor", *(["--cell", cell] if cell else []))


def _become(module: str, *arguments: str) -> NoReturn:
    """Replaces this process by `python -m module`: no parent in between that could swallow a signal."""
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])


def cell_path(folder: Path, name: str) -> Path:
    """Returns the file of a cell; refuses a name that is not there."""
    path = folder / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.toml"))) or "none"
        raise click.ClickException(f"no cell {name!r} in {folder}; there are: {known}")
    return path


def say_starting(what: str) -> None:
    """Shows progress."""
    click.echo(f"starting the {what} …")


def catch_signals() -> None:
    """Makes SIGTERM, and SIGINT even where a shell had it ignored, stop everything like Ctrl-C."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _interrupt)


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt
