"""A service of its own: what serves the page, without a robot or with a simulated one."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx2

ROOT = Path(__file__).parents[2]
CELL = "ur5e-sim"
HOST = "127.54.0.1"  # an address of its own for the simulated controller
FLING = "from api.cli import main; main()"
READY_S = 180.0  # [s] on a busy machine


@contextmanager
def service(robot: bool = False) -> Iterator[str]:
    """Runs a service with one planner process, and with a simulated arm and its executor; yields its address."""
    with TemporaryDirectory() as folder:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        cell = (ROOT / "cells" / f"{CELL}.toml").read_text(encoding="utf-8")
        (Path(folder) / f"{CELL}.toml").write_text(re.sub(r'host = "127[^"]*"', f'host = "{HOST}"', cell))
        own = {
            "FLING_DATABASE_URL": f"sqlite:///{folder}/fling.db",
            "FLING_DATA": folder,
            "FLING_CELLS": folder,
            "FLING_PLANNER_WORKERS": "1",
        }
        command = [sys.executable, "-c", FLING, "up" if robot else "serve", "--port", str(port)]
        process = subprocess.Popen(
            command, cwd=ROOT, env={**os.environ, **own}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            yield _ready(f"http://127.0.0.1:{port}")
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(READY_S)


def _ready(url: str) -> str:
    """Waits until the service answers; returns its address."""
    deadline = time.monotonic() + READY_S
    with httpx2.Client(trust_env=False) as client:
        while time.monotonic() < deadline:
            try:
                if client.get(f"{url}/readyz").status_code == httpx2.codes.OK:
                    return url
            except httpx2.TransportError:
                pass
            time.sleep(0.1)
    raise TimeoutError(f"the service was not ready within {READY_S:g} s")
