"""Simulator, executor and service of one cell, started together."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

from api.cli.client import Client, ServiceError
from api.cli.processes import ChildFailed, Children

READY_S = 60.0  # [s] a cold machine imports and builds for a while
POLL_S = 0.1

Say = Callable[[str], None]


def start_stack(children: Children, cells: Path, cell: str, url: str, is_simulated: bool, say: Say) -> None:
    """Starts the processes one after another and waits until the service has an executor for `cell`.

    Raises:
        ChildFailed: one of them did not come up.
    """
    if is_simulated:
        say("simulated controller")
        children.start("simulator", "executor.simulator", ["--cell", str(cells / f"{cell}.toml")], READY_S)
    say("executor")
    children.start("executor", "executor", ["--cell", cell], READY_S)
    say("service")
    children.start("service", "api")
    wait_ready(children, url, cell)


def wait_ready(children: Children, url: str, cell: str) -> None:
    """Waits until the service plans and the executor of `cell` has been heard of.

    Raises:
        ChildFailed: a child ended, or it took longer than `READY_S`.
    """
    deadline, why = time.monotonic() + READY_S, ""
    with Client(url, os.environ.get("FLING_TOKEN")) as client:
        while time.monotonic() < deadline:
            children.check()
            try:
                if client.get("/readyz")["cells"].get(cell):
                    return
                why = "the executor was not heard of"
            except ServiceError as error:
                why = error.message
            time.sleep(POLL_S)
    raise ChildFailed(f"not ready within {READY_S:g} s: {why}")
