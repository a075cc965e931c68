"""A service of its own, without a robot: what serves the page."""

from __future__ import annotations

import os
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
READY_S = 180.0  # [s] on a busy machine


@contextmanager
def service() -> Iterator[str]:
    """Runs a service with one planner process; yields its address."""
    with TemporaryDirectory() as folder:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        own = {
            "FLING_DATABASE_URL": f"sqlite:///{folder}/fling.db",
            "FLING_PORT": str(port),
            "FLING_CELLS": str(ROOT / "cells"),
            "FLING_PLANNER_WORKERS": "1",
        }
        process = subprocess.Popen(
            [sys.executable, "-m", "api"], cwd=ROOT, env={**os.environ, **own}, stderr=subprocess.DEVNULL
        )
        try:
            yield _ready(f"http://127.0.0.1:{port}")
        finally:
            process.terminate()
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
