"""Settings of the executor: from FLING_* environment variables; the command line overrides."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from planner.cell_folder import default_cells_folder
from store import default_database_url

WATCHDOG_MIN_HZ, WATCHDOG_MAX_HZ = 10.0, 50.0  # [Hz] outside: coasts too long, or trips by itself (faults.md, 2.2)
PACE_MIN, PACE_MAX = 0.1, 2.0  # [-] slower is no approach, faster is a throw
PRIORITY = 50  # of SCHED_FIFO; below the kernel's interrupt threads on any machine


@dataclass(frozen=True)
class Settings:
    """What one executor needs to know.

    Attributes:
        cell: name of the cell.
        cells: folder of cell files.
        database_url: of the store.
        data: folder for what must survive: results not delivered yet, a latched fault.
        read_only: connect and show, never move.
        watchdog_hz: least command rate the controller accepts [Hz]; None: by whether real time is permitted.
        core: processor the streaming process stays on; -1: any.
        approach_pace: how fast the arm goes to a plan's start; 2 takes half as long as 1.

    Raises:
        ValueError: a value that cannot be meant.
    """

    cell: str
    cells: Path
    database_url: str
    data: Path
    read_only: bool = False
    watchdog_hz: float | None = None
    core: int = -1
    approach_pace: float = 1.0

    def __post_init__(self) -> None:
        if self.watchdog_hz is not None and not WATCHDOG_MIN_HZ <= self.watchdog_hz <= WATCHDOG_MAX_HZ:
            raise ValueError(
                f"FLING_WATCHDOG_HZ {self.watchdog_hz:g} is not within {WATCHDOG_MIN_HZ:g} and {WATCHDOG_MAX_HZ:g} Hz"
            )

        if not PACE_MIN <= self.approach_pace <= PACE_MAX:
            raise ValueError(f"FLING_APPROACH_PACE {self.approach_pace:g} is not within {PACE_MIN:g} and {PACE_MAX:g}")

    @property
    def cell_path(self) -> Path:
        """The cell's file."""
        return self.cells / f"{self.cell}.toml"

    @classmethod
    def from_environment(cls, environment: Mapping[str, str], cell: str | None, read_only: bool) -> Settings:
        """Returns the settings of `environment`; `cell` overrides FLING_DEFAULT_CELL."""
        data = environment.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
        name = cell or environment.get("FLING_DEFAULT_CELL", "ur5e-sim")
        return cls(
            cell=name,
            cells=Path(environment.get("FLING_CELLS") or default_cells_folder()),
            database_url=environment.get("FLING_DATABASE_URL") or default_database_url(),
            data=Path(environment.get("FLING_DATA") or Path(data) / "fling") / "executor" / name,
            read_only=read_only,
            watchdog_hz=float(hz) if (hz := environment.get("FLING_WATCHDOG_HZ")) else None,
            core=int(environment.get("FLING_STREAM_CORE", last_core())),
            approach_pace=float(environment.get("FLING_APPROACH_PACE") or 1.0),
        )


def last_core() -> int:
    """Returns the highest processor this process may use: interrupts and planners gather on the low ones."""
    return max(os.sched_getaffinity(0))
