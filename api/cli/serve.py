"""Commands that run the processes: up, serve, executor, doctor."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from api.cli.cell_new import first_throw
from api.cli.simulator import OTHER_HOST, truth_arguments, truth_options
from api.cli.support.addresses import SIMULATOR_PORTS
from api.cli.support.options import JSON_FLAG, PORT, cell_option, json_option, service_url
from api.cli.support.terminal import BAD, GOOD, say

if TYPE_CHECKING:
    from api.cli.support.processes import ChildProcesses
    from api.settings import ServiceSettings
    from planner.cell import Cell

SERVICE_SETTINGS = """Settings of the environment without an option, and their defaults:

FLING_DATA (`fling` in the user's data folder): the executors' folder, with their stop sockets

FLING_PLANNER_QUEUE (16): requests that may wait; further ones are answered 429

FLING_BATCH_WORKERS (number of cores - 1; all of a cluster): planner processes of a batch, besides the service's own;
0: another service plans, and carries jobs out

FLING_RAY_ADDRESS (none): Ray cluster that plans batches

FLING_KEEP_PLANS, FLING_KEEP_EXECUTIONS, FLING_KEEP_BATCHES (all), each also with _DAYS: how many are kept, how long

FLING_REQUEST_LOG (on): off: no line in the log for each request
"""
EXECUTOR_SETTINGS = """Settings of the environment, and their defaults:

FLING_DATABASE_URL, FLING_CELLS: store and folder of cell files, as of `fling serve`

FLING_DATA (`fling` in the user's data folder): undelivered results, latched fault, output of the streaming process
(streaming.log) and of the one that waits for the next execution (streaming-next.log)

FLING_WATCHDOG_HZ (50, without real time 20): lowest command rate accepted by the controller, 10 to 50

FLING_DEAD_MAN_S (0.04): time without a heartbeat after which a program inside the controller stops the arm, 0.02 to 0.2

FLING_STREAM_CORE (the highest): processor of the stream, and of a simulated controller; -1: any

FLING_KEEP_AWAKE (on): off: let the stream's processor sleep during an execution

FLING_VERIFY (off): on: every plan, also one that replaces another, must be proven by `fling verify`, which takes 0.2 to
0.5 s before an approach; what that does not cover is refused by name

FLING_APPROACH_PACE (1): pace of the approach to a plan's start, 0.1 to 2; at 1: 1 rad/s and 1.4 rad/s², movej's default
"""
PATIENCE_HELP = "How long to wait for each process to be ready [s]; default: 300."


@click.command()
@cell_option()
@click.option("--port", type=PORT, help="Port of the service; default: FLING_PORT, or 8000.")
@click.option("--patience", type=click.FloatRange(min=0.0, min_open=True), metavar="S", help=PATIENCE_HELP)
@truth_options
def up(cell: str | None, port: int | None, patience: float | None, truth: Path | None, reveal: bool) -> None:
    """Run simulated controller, executor, service, SQLite and web page on this machine until Ctrl-C.

    A process that ends by itself is started again, and named; one that ends again and again stops everything.
    """
    from api.cli.support.addresses import require_free
    from api.cli.support.processes import (
        READY_S,
        ChildFailed,
        ChildProcesses,
        catch_signals,
        require_streaming_client,
        start_all,
    )
    from api.settings import read_settings

    require_streaming_client()
    settings = read_settings(default_cell=cell, port=port)
    name = cell or settings.default_cell
    number = port or settings.port
    station = _prepare(settings.cells, name, settings.database_url)
    simulated = station.link.kind == "sim"
    require_free(settings.host, [number], "the service", "or choose another port: --port")
    if simulated:
        require_free(station.link.host, SIMULATOR_PORTS, "the simulated controller", f"or {OTHER_HOST}")
    url = f"http://{'127.0.0.1' if settings.host == '0.0.0.0' else settings.host}:{number}"
    catch_signals()
    try:
        with ChildProcesses(_environment(settings, name, number)) as children:
            truth_flags = truth_arguments(truth, reveal)
            start_all(children, settings.cells, name, url, simulated, truth_flags, patience or READY_S)
            say(f"\nFling is up: {url}    (OpenAPI: {url}/docs)", GOOD)
            say(f"try: {first_throw(station)}{'' if url == service_url(None) else f' --url {url}'}\nCtrl-C stops all.")
            _keep_alive(children)
    except KeyboardInterrupt:
        click.echo("\nstopped.")
    except ChildFailed as error:
        raise click.ClickException(f"{error}; everything was stopped") from error


def _environment(settings: ServiceSettings, cell: str, port: int) -> dict[str, str]:
    """Returns the settings of the processes that `fling up` starts."""
    return {
        "FLING_PORT": str(port),
        "FLING_CELLS": str(settings.cells),
        "FLING_DEFAULT_CELL": cell,
        "FLING_DATABASE_URL": settings.database_url,
        "FLING_REQUEST_LOG": os.environ.get("FLING_REQUEST_LOG", "off"),  # the terminal is for people
    }


def _keep_alive(children: ChildProcesses) -> None:
    """Starts again what ends by itself, until Ctrl-C."""
    while True:
        time.sleep(0.5)
        for sentence in children.revive():
            say(f"fling: {sentence}", BAD, err=True)


@click.command(epilog=SERVICE_SETTINGS)
@click.option("--host", help="Address to listen on; default: FLING_HOST, or 127.0.0.1.")
@click.option("--port", type=PORT, help="Port to listen on; default: FLING_PORT, or 8000.")
@click.option(
    "--cells",
    type=click.Path(path_type=Path),
    help="Folder of cell files; default: FLING_CELLS, or ./cells, or the shipped ones.",
)
@click.option("--cell", "default_cell", help="The default cell of requests; default: FLING_DEFAULT_CELL, or ur5e-sim.")
@click.option(
    "--database-url",
    help="Database, or postgresql+psycopg://…, after `fling db upgrade`; default: FLING_DATABASE_URL, or SQLite in the "
    "user's data folder.",
)
@click.option(
    "--tokens-file", type=click.Path(path_type=Path), help="File of the bearer tokens; default: FLING_TOKENS_FILE."
)
@click.option(
    "--trusted-proxies",
    help="Addresses and networks of reverse proxies, separated by commas, whose X-Forwarded-For is believed; default: "
    "FLING_TRUSTED_PROXIES.",
)
@click.option(
    "--planner-workers",
    type=click.IntRange(min=1),
    help="Planner processes; default: FLING_PLANNER_WORKERS, or the number of cores - 1.",
)
def serve(**flags: object) -> None:
    """Run the service alone: HTTP on one address, with its planner processes."""
    from api.app import serve as run
    from api.cli.support.addresses import require_free
    from api.settings import read_settings

    settings = read_settings(**flags)
    require_free(settings.host, [settings.port], "the service", "or choose another port: --port")
    sys.exit(run(settings))


@click.command(epilog=EXECUTOR_SETTINGS)
@cell_option()
@click.option("--read-only", is_flag=True, help="Connect, report state and preflight, never move.")
def executor(cell: str | None, read_only: bool) -> None:
    """Run the executor of one cell: it claims executions and streams them to the controller."""
    _exec("executor", *_cell_argument(cell), *(["--read-only"] if read_only else []))


@click.command()
@cell_option()
@json_option
def doctor(cell: str | None, as_json: bool) -> None:
    """Check this machine's timing and the link to the cell's controller, with advice.

    Exit status: 0 fit to stream; 1 fit for simulation, with warnings to resolve before using a real arm; 2 unfit.
    """
    _exec("executor", "--doctor", *_cell_argument(cell), *([JSON_FLAG] if as_json else []))


def _cell_argument(cell: str | None) -> list[str]:
    """Returns the argument that names a cell; refuses a name that is in no file, with those that are."""
    from api.cli.support.processes import cell_path
    from api.settings import parse_settings

    if cell is None:
        return []
    cell_path(parse_settings().cells, cell)
    return ["--cell", cell]


def _prepare(cells: Path, name: str, database_url: str) -> Cell:
    """Checks the cell as `fling cell check` does, tells its warnings, and migrates the database. Returns the cell."""
    from api.cli.admin import CellRefused
    from api.cli.support.cell_warnings import warnings_of
    from api.cli.support.processes import cell_path
    from planner.cell import load_cell
    from planner.cell_folder import file_faults
    from store import Store

    path = cell_path(cells, name)
    if faults := file_faults(path):
        raise CellRefused({path: faults})
    cell = load_cell(path)
    for warning in warnings_of(cell):
        say(f"{name}: {warning}", BAD)
    Store.upgrade(database_url)
    return cell


def _exec(module: str, *arguments: str) -> NoReturn:
    """Replaces this process by `python -m module`, so that signals reach it directly."""
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *arguments])
