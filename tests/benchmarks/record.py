"""Rows on disk, one JSON document a line, so that a run can be continued; and the machine it ran on."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tests.benchmarks.task import Row

PACKAGES = ("numpy", "casadi", "ruckig", "toppra", "drake", "pin", "mujoco")


class Record:
    """Rows as they come, appended to a file; those already there are not run again."""

    def __init__(self, path: Path, resume: bool) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        if not resume:
            path.unlink(missing_ok=True)
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.rows = [Row(**json.loads(line)) for line in lines]
        self._done = {(row.task, row.backend) for row in self.rows}

    def has(self, task: str, backend: str) -> bool:
        return (task, backend) in self._done

    def add(self, row: Row) -> None:
        self.rows.append(row)
        self._done.add((row.task, row.backend))
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row.document()) + "\n")


def machine() -> dict[str, str]:
    """Returns what a reader must know to compare: processor, system, versions, date, load."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        "load": f"{os.getloadavg()[0]:.1f} of the last minute at the start",
        "commit": _commit(),
        "versions": ", ".join(f"{name} {_version(name)}" for name in PACKAGES),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _commit() -> str:
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
