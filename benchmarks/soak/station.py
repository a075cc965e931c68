"""The processes of a soak, on an address of their own, and what they use."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import httpx2
import psutil

from store import Store

ROOT = Path(__file__).parents[2]
CELL = "soak"
READY_S = 120.0  # [s] until everything has started, on a busy machine
END_S = 60.0  # [s] until a process has ended that was asked to
SHARED_MEMORY = Path("/dev/shm")
MB = 1e6


@dataclass(frozen=True)
class Usage:
    """What the processes of one role use together.

    Attributes:
        role: service, executor or simulator.
        at_s: since the soak began [s].
        memory_mb: resident memory [MB].
        descriptors, threads, sockets: their numbers.
    """

    role: str
    at_s: float
    memory_mb: float
    descriptors: int
    threads: int
    sockets: int


class Station:
    """Service, executor and simulated controller of one cell; a context manager.

    Args:
        folder: for database, cells and logs.
        host: loopback address of the simulated controller.
    """

    def __init__(self, folder: Path, host: str) -> None:
        self.folder = folder
        self.began_at = time.monotonic()
        cells = folder / "cells"
        cells.mkdir(parents=True)
        text = (ROOT / "cells" / "ur5e-sim.toml").read_text()
        (cells / f"{CELL}.toml").write_text(re.sub(r'host = "[^"]*"', f'host = "{host}"', text))
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.database_url = f"sqlite:///{folder / 'fling.db'}"
        self._environment = {
            **os.environ,
            "FLING_DATABASE_URL": self.database_url,
            "FLING_CELLS": str(cells),
            "FLING_DEFAULT_CELL": CELL,
            "FLING_DATA": str(folder / "data"),
            "FLING_PORT": str(self.port),
            "FLING_PLANNER_WORKERS": "1",
            "FLING_BATCH_WORKERS": "1",
            "FLING_KEEP_PLANS": "500",
            "FLING_KEEP_EXECUTIONS": "200",
            "FLING_KEEP_BATCHES": "50",
            "FLING_REQUEST_LOG": "off",
        }
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.revived: Counter[str] = Counter()
        Store.upgrade(self.database_url)

    def __enter__(self) -> Station:
        for role in ("simulator", "executor", "service"):
            self._start(role)
        deadline = time.monotonic() + READY_S
        while not self._is_ready():
            if time.monotonic() > deadline:
                raise TimeoutError(f"the station is not ready; see {self.folder}")
            time.sleep(0.5)
        return self

    def __exit__(self, *_: object) -> None:
        for role in ("service", "executor", "simulator"):
            process = self._processes[role]
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def revive(self) -> None:
        """Starts again what has ended, as `fling up` does; the service never ends by itself."""
        for role, process in list(self._processes.items()):
            if process.poll() is not None:
                self.revived[role] += 1
                self._start(role)

    def kill(self, role: str) -> bool:
        """Kills the executor's daemon, its streaming process, a planner process or a batch's driver; whether it ran."""
        if role == "executor":
            self._processes["executor"].send_signal(signal.SIGKILL)
            return True
        words = {"streaming": "executor.streaming", "planner": "spawn_main", "driver": "-m jobs"}[role]
        parent = self._processes["executor" if role == "streaming" else "service"].pid
        for child in psutil.Process(parent).children():
            try:
                if words in " ".join(child.cmdline()):
                    child.kill()
                    return True
            except psutil.Error:
                continue
        return False

    def usages(self) -> list[Usage]:
        """Returns what each role uses now; nothing of one that has just ended."""
        found = []
        for role, process in self._processes.items():
            try:
                found.append(self._usage(role, psutil.Process(process.pid)))
            except (psutil.Error, OSError):
                continue
        return found

    def shared_memory(self) -> int:
        """Returns the number of blocks of shared memory that this machine's processes have left or have in use."""
        return sum(1 for _ in SHARED_MEMORY.iterdir()) if SHARED_MEMORY.is_dir() else 0

    def errors(self) -> list[str]:
        """Returns the lines of the service's log that are errors."""
        text = (self.folder / "service.log").read_text(errors="replace")
        return [line for line in text.splitlines() if '"level": "error"' in line or line.startswith("Traceback")]

    def _usage(self, role: str, process: psutil.Process) -> Usage:
        with process.oneshot():
            sockets = sum(1 for target in _descriptor_targets(process.pid) if target.startswith("socket:"))
            memory = process.memory_info().rss / MB
            counts = (process.num_fds(), process.num_threads(), sockets)
        return Usage(role, time.monotonic() - self.began_at, memory, *counts)

    def _start(self, role: str) -> None:
        arguments = {
            "simulator": ["-m", "simulator", "--cell", str(self.folder / "cells" / f"{CELL}.toml")],
            "executor": ["-m", "executor", "--cell", CELL],
            "service": ["-m", "api"],
        }[role]
        with (self.folder / f"{role}.log").open("ab") as log:
            self._processes[role] = subprocess.Popen(
                [sys.executable, *arguments], cwd=ROOT, env=self._environment, stdout=log, stderr=log
            )

    def _is_ready(self) -> bool:
        try:
            ready = httpx2.get(f"{self.url}/readyz", timeout=10.0)
            return ready.status_code == 200 and ready.json()["cells"].get(CELL, False)
        except httpx2.TransportError:
            return False


def _descriptor_targets(pid: int) -> list[str]:
    folder = Path(f"/proc/{pid}/fd")
    found = []
    for entry in folder.iterdir():
        try:
            found.append(os.readlink(entry))
        except OSError:  # it has just been closed
            continue
    return found
