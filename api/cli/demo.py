"""`fling demo`: start everything on free addresses, throw once, report, stop."""

from __future__ import annotations

import math
import os
import re
import socket
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.summary import landing_text

if TYPE_CHECKING:
    from api.cli.client import ServiceClient

TARGET_M = (1.2, 0.3, 0.0)  # [m] on the floor, 1.24 m from the base
MISS_MAX_M = 0.010  # [m] a larger landing error is a failure
ACKNOWLEDGE_TIMEOUT_S = 5.0  # [s] the executor acknowledges at its next heartbeat
THROWS_MAX = 3  # a busy machine may miss ticks; after this many late throws it is unfit for a demo


@click.command()
@click.option("--cell", default="ur5e-sim", show_default=True, help="Which simulated cell.")
@click.option("--keep", type=click.Path(path_type=Path), help="Keep database and logs in this folder.")
def demo(cell: str, keep: Path | None) -> None:
    """Start everything, throw once, report, stop. Exit status 0 only where it landed within 10 mm of the target."""
    from api.cli.processes import catch_signals, cell_path
    from api.settings import ServiceSettings

    catch_signals()
    original = cell_path(ServiceSettings().cells, cell)
    with tempfile.TemporaryDirectory(prefix="fling-demo-") as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        _copy_cell(original, folder)
        try:
            missed_m = _throw(folder, cell)
        except KeyboardInterrupt:
            raise click.ClickException("interrupted") from None
    if not missed_m <= MISS_MAX_M:
        raise click.ClickException(f"it missed the target by {1000 * missed_m:.1f} mm")
    click.echo(f"\nThe object landed {1000 * missed_m:.1f} mm from the target.")


def _copy_cell(original: Path, folder: Path) -> None:
    """Copies the cell with a loopback address of its own, so that another simulator does not interfere."""
    host = f"127.{100 + os.getpid() % 100}.{os.getpid() >> 8 & 255}.{os.getpid() & 255 or 1}"
    text, count = re.subn(r'(?m)^(host\s*=\s*)"127\.[\d.]+"', rf'\g<1>"{host}"', original.read_text())
    if count != 1:
        raise click.ClickException(f"{original} is not a simulated cell on this machine")
    (folder / original.name).write_text(text)


def _throw(folder: Path, cell: str) -> float:
    """Starts all processes, throws and stops. Returns the landing error [m]; NaN if nothing landed."""
    from api.cli.client import ServiceClient, ServiceError
    from api.cli.processes import ChildFailed, ChildProcesses, start_all
    from api.cli.throw import plan_and_execute

    port, log = _free_port(), folder / "log.txt"
    url = f"http://127.0.0.1:{port}"
    environment = {
        "FLING_DATABASE_URL": f"sqlite:///{folder / 'fling.db'}",
        "FLING_CELLS": str(folder),
        "FLING_DATA": str(folder),
        "FLING_DEFAULT_CELL": cell,
        "FLING_HOST": "127.0.0.1",
        "FLING_PORT": str(port),
    }
    try:
        with ChildProcesses(environment, log) as children, ServiceClient(url) as client:
            start_all(children, folder, cell, url, is_simulated=True)
            request = {"cell": cell, "release": {"kind": "target", "position": list(TARGET_M)}}
            _, execution = plan_and_execute(client, request, "speedj", False)
            for _ in range(THROWS_MAX - 1):
                if execution["outcome"] != "late":
                    break
                _acknowledge_late(client, cell, execution)
                _, execution = plan_and_execute(client, request, "speedj", False)
    except (ChildFailed, ServiceError) as error:
        raise click.ClickException(f"{error}\n{_tail(log)}") from error
    if execution["outcome"] != "completed":
        raise click.ClickException(f"{execution['outcome']}: {execution['reason']}\n{_tail(log)}")
    click.echo(landing_text(execution))
    return _landing_error(execution)


def _acknowledge_late(client: ServiceClient, cell: str, execution: dict[str, Any]) -> None:
    """Reports that the machine was too busy and clears the fault: nobody stands beside a simulated arm."""
    click.echo(f"late: {execution['reason']}; this machine is busy. Acknowledged; throwing again …")
    client.post(f"/cells/{cell}/acknowledge")
    deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT_S
    while client.get(f"/cells/{cell}/state")["fault"] is not None and time.monotonic() < deadline:
        time.sleep(0.1)


def _landing_error(execution: dict[str, Any]) -> float:
    point = (execution["metrics"] or {}).get("landing_point")
    return math.nan if point is None else math.dist(point, TARGET_M)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def _tail(log: Path) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-20:])
