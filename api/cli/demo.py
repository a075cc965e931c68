"""`fling demo`: start everything on free addresses, throw on an ideal arm and on one as measured, report, stop."""

from __future__ import annotations

import math
import os
import re
import shutil
import socket
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.progress import execute_plan, make_plan
from api.cli.support.summary import BUSY_HINT, ending_text, landing_text

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient
    from api.cli.support.processes import ChildProcesses

TARGET_M = (1.2, 0.3, 0.0)  # [m] on the floor, 1.24 m from the base
MISS_MAX_M = 0.010  # [m] a larger landing error is a failure
CONNECT_TIMEOUT_S = 20.0  # [s] the executor reconnects within a second
MEASURED_ARM = '[arm]\ndisturbance = "ur5-measured"\n'  # truth file of the second arm
MEASURED_TOLERANCE_M = 0.1  # [m] for that arm: with the default of 2 cm the executor keeps what would land further off
MEASURED_THROWS = 5  # on that arm: its landings scatter
LOG = "log.txt"  # what all processes write
THROWS_MAX = 3  # a busy machine may miss ticks; after this many such throws it is unfit for a demo
# Outcomes of a machine that is too busy, without real-time priority: docs/executor.md; and of a stream that was silent.
BUSY = ("late", "link_lost", "tracking", "executor_lost")


class ThrowFailed(Exception):
    """A throw of the demo ended otherwise than completed; the text says how, and what to do."""


@dataclass
class Landings:
    """What the throws have come to so far.

    Attributes:
        ideal_m: landing error of the ideal arm [m]; None before its throw, NaN where nothing landed.
        measured_m: those of the arm as measured [m].
    """

    ideal_m: float | None = None
    measured_m: list[float] = field(default_factory=list)


@click.command()
@click.option("--cell", default="ur5e-sim", show_default=True, help="Which simulated cell.")
@click.option("--keep", type=click.Path(path_type=Path), help="Keep database and logs in this folder.")
def demo(cell: str, keep: Path | None) -> None:
    """Start everything, throw on an ideal arm and on one as measured on a real UR5, report, stop.

    Exit status 0 only where the ideal arm's object landed within 10 mm of the target.
    """
    from api.cli.support.client import ServiceError
    from api.cli.support.processes import ChildFailed, catch_signals, cell_path, require_streaming_client
    from api.settings import parse_settings

    require_streaming_client()
    catch_signals()
    original = cell_path(parse_settings().cells, cell)
    with tempfile.TemporaryDirectory(prefix="fling-demo-") as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        _copy_cell(original, folder)
        landings = Landings()
        try:
            missed_m = _throw(folder, cell, landings)
        except KeyboardInterrupt:
            raise click.ClickException("interrupted") from None
        except (ChildFailed, ServiceError, ThrowFailed) as error:
            log = folder / LOG if keep else _kept(folder / LOG)
            raise click.ClickException(f"{error}\nwhat the processes wrote: {log}") from error
        finally:
            click.echo(_landings_text(landings), nl=False)
    if not missed_m <= MISS_MAX_M:
        raise click.ClickException(f"it missed the target by {1000 * missed_m:.1f} mm")
    click.echo(
        "Between the two lies what nobody has measured yet. A cell learns its timing in three minutes: "
        "fling calibrate lag, then fling calibrate gripper."
    )


def _landings_text(landings: Landings) -> str:
    """Returns what the throws came to that were completed, a line an arm; nothing without one."""
    text = ""
    if landings.ideal_m is not None:
        text += f"\nIdeal arm: the object landed {1000 * landings.ideal_m:.1f} mm from the target.\n"
    if landings.measured_m:
        most, median, least = (1000 * f(landings.measured_m) for f in (max, statistics.median, min))
        count = len(landings.measured_m)
        text += (
            f"Arm as measured on a real UR5, {count} throw{'s' if count > 1 else ''} with a tolerance of "
            f"{1000 * MEASURED_TOLERANCE_M:.0f} mm: {median:.0f} mm in the median ({least:.0f} to {most:.0f}).\n"
        )
    return text


def _copy_cell(original: Path, folder: Path) -> None:
    """Copies the cell with a loopback address of its own, so that another simulator does not interfere."""
    host = f"127.{100 + os.getpid() % 100}.{os.getpid() >> 8 & 255}.{os.getpid() & 255 or 1}"
    text, count = re.subn(r'(?m)^(host\s*=\s*)"127\.[\d.]+"', rf'\g<1>"{host}"', original.read_text())
    if count != 1:
        raise click.ClickException(f"{original} is not a simulated cell on this machine")
    (folder / original.name).write_text(text)


def _throw(folder: Path, cell: str, landings: Landings) -> float:
    """Starts all processes, throws on both arms and stops; adds to `landings` as it goes.

    Returns:
        The landing error of the ideal arm [m]; NaN where nothing landed.
    """
    from api.cli.support.client import ServiceClient
    from api.cli.support.processes import ChildProcesses, start_all

    port = _free_port()
    url = f"http://127.0.0.1:{port}"
    environment = {
        "FLING_DATABASE_URL": f"sqlite:///{folder / 'fling.db'}",
        "FLING_CELLS": str(folder),
        "FLING_DATA": str(folder),
        "FLING_DEFAULT_CELL": cell,
        "FLING_HOST": "127.0.0.1",
        "FLING_PORT": str(port),
        "FLING_REQUEST_LOG": "off",
    }
    with ChildProcesses(environment, folder / LOG) as children, ServiceClient(url) as client:
        start_all(children, folder, cell, url, is_simulated=True)
        request = {"cell": cell, "release": {"kind": "target", "position": list(TARGET_M)}}
        ideal = _execute(client, make_plan(client, request))
        click.echo(landing_text(ideal))
        ideal_m = landings.ideal_m = _landing_error(ideal)
        _exchange_arm(children, client, folder, cell)
        plan = make_plan(client, {**request, "landing_tolerance_m": MEASURED_TOLERANCE_M}, progress=False)
        for i in range(1, MEASURED_THROWS + 1):
            missed_m = _landing_error(_execute(client, plan, progress=False))
            landings.measured_m.append(missed_m)
            click.echo(f"throw {i} of {MEASURED_THROWS}: {1000 * missed_m:.0f} mm")
    return ideal_m


def _execute(client: ServiceClient, plan: dict[str, Any], progress: bool = True) -> dict[str, Any]:
    """Executes a plan, again if this machine was too busy. Returns the execution.

    Raises:
        ThrowFailed: It ended otherwise.
    """
    execution = execute_plan(client, plan, progress=progress)
    for _ in range(THROWS_MAX - 1):
        if execution["outcome"] not in BUSY:
            break
        _acknowledge_busy(client, plan["cell"], execution)
        execution = execute_plan(client, plan, progress=progress)
    if execution["outcome"] != "completed":
        said = ending_text(execution)
        is_hinted = execution["outcome"] not in BUSY or said.endswith(BUSY_HINT)
        raise ThrowFailed(said if is_hinted else f"{said}; {BUSY_HINT}")
    return execution


def _exchange_arm(children: ChildProcesses, client: ServiceClient, folder: Path, cell: str) -> None:
    """Replaces the ideal arm by one as measured, and waits until the executor is connected to it.

    The executor has to miss the first arm before: what it last said of that one would pass for the second.

    Raises:
        ThrowFailed: It does not connect.
    """
    from api.cli.support.processes import start_simulator

    click.echo("\nexchanging the arm for one as measured on a real UR5, and throwing again …")
    truth = folder / "measured-arm.truth"
    truth.write_text(MEASURED_ARM)
    children.end("simulator")
    _wait_until_ready(client, cell, is_ready=False, failure="the executor did not miss the first arm")
    start_simulator(children, folder / f"{cell}.toml", ["--truth", str(truth), "--reveal"])
    _wait_until_ready(client, cell, is_ready=True, failure="the executor did not connect to the second arm")


def _wait_until_ready(client: ServiceClient, cell: str, is_ready: bool, failure: str) -> None:
    """Waits until a cell's robot may move, or until it may not.

    Raises:
        ThrowFailed: With `failure`, after `CONNECT_TIMEOUT_S`.
    """
    deadline = time.monotonic() + CONNECT_TIMEOUT_S
    while ((client.get(f"/cells/{cell}/state")["robot"] or {}).get("refusals") == []) is not is_ready:
        if time.monotonic() > deadline:
            raise ThrowFailed(failure)
        time.sleep(0.1)


def _acknowledge_busy(client: ServiceClient, cell: str, execution: dict[str, Any]) -> None:
    """Reports that the machine was too busy and clears the fault: nobody stands beside a simulated arm."""
    click.echo(f"{execution['outcome']}: {execution['reason']}; this machine is busy. Acknowledged; throwing again …")
    client.acknowledge(cell)


def _landing_error(execution: dict[str, Any]) -> float:
    point = (execution["metrics"] or {}).get("landing_point")
    return math.nan if point is None else math.dist(point, TARGET_M)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def _kept(log: Path) -> Path:
    """Returns a copy of the log that outlives the demo's own folder."""
    handle, name = tempfile.mkstemp(prefix="fling-demo-", suffix=".log")
    os.close(handle)
    return Path(shutil.copyfile(log, name))
