"""Results of the benchmark: one row per back end and task, kept on disk, and the machine of the run."""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("numpy", "casadi", "ruckig", "toppra", "drake", "pin", "mujoco")


@dataclass
class ResultRow:
    """Result of one back end on one task. Times in seconds, distances in metres; None without an answer.

    Attributes:
        task: Name of the task.
        backend: Requested back end, or the search for any feasible motion.
        outcome: "certified", "infeasible", "failed" or "invalid".
        by: Back end that found the plan.
        release_time_s: Time of the release; NaN without a motion.
        duration_s: Duration of the motion.
        solve_s: Wall time of `plan()`, warm.
        cpu_s: Processor time of the same call, less affected by a busy machine.
        certificate_s: Wall time of certifying the plan once more.
        window_m: Largest landing error for releases within ±10, ±20 and ±30 ms, by "10", "20", "30".
        bound_s: Joint-wise lower bound of the release time; None if the posture is free.
        tick_s: Period of the controller.
        nearest: For an infeasible task: "certified", "wrong" or "none".
        reason: Failed checks, or the planner's refusal.
    """

    task: str
    backend: str
    outcome: str
    by: str = ""
    release_time_s: float = math.nan
    duration_s: float | None = None
    solve_s: float = 0.0
    cpu_s: float = 0.0
    certificate_s: float | None = None
    window_m: dict[str, float] = field(default_factory=dict)
    bound_s: float | None = None
    tick_s: float = 0.002
    nearest: str = ""
    reason: str = ""

    @property
    def certified(self) -> bool:
        """Whether the plan passed its certificate."""
        return self.outcome == "certified"

    @property
    def group(self) -> str:
        """Name of the task's set."""
        return self.task.split("/")[0]


def kept_rows(path: Path, resume: bool) -> list[dict[str, Any]]:
    """Returns the rows of a file, one JSON document a line: none without `resume`, which begins it anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not resume:
        path.unlink(missing_ok=True)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def add_row(path: Path, row: Mapping[str, Any]) -> None:
    """Appends a row to a file of them."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


class ResultFile:
    """Rows appended to a file, one JSON document per line; an interrupted run continues after them.

    Args:
        path: The file.
        resume: Whether to keep the rows that it has.
    """

    def __init__(self, path: Path, resume: bool) -> None:
        self.path = path
        self.rows = [ResultRow(**row) for row in kept_rows(path, resume)]
        self._done = {(row.task, row.backend) for row in self.rows}

    def has(self, task: str, backend: str) -> bool:
        """Returns whether there is a row of this task and back end."""
        return (task, backend) in self._done

    def add(self, row: ResultRow) -> None:
        """Appends a row."""
        self.rows.append(row)
        self._done.add((row.task, row.backend))
        add_row(self.path, asdict(row))


def machine() -> dict[str, str]:
    """Returns the conditions of a run: processor, system, versions, date, load."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        "load": f"{os.getloadavg()[0]:.1f} of the last minute at the start",
        "commit": _commit(),
        "versions": ", ".join(f"{name} {_version(name)}" for name in PACKAGES),
    }


def machine_words(about: Mapping[str, str]) -> str:
    """Returns the conditions of a run, from `machine`, as a sentence of its page on two lines."""
    return (
        f"{about['date']}, {about['processor']}, {about['system']}; load {about['load']}; commit {about['commit']};\n"
        f"{about['versions']}."
    )


def write_report(text: str, folder: Path | None, name: str) -> None:
    """Writes a report as a file of that name into a folder, which is made; to standard output without a folder."""
    if folder is None:
        sys.stdout.write(text)
        return
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")


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
