"""Settings of the executor, from FLING_* environment variables; the command line overrides them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from executor import realtime
from fling import stop_socket, this_machine
from planner.cell_folder import default_cells_folder

WATCHDOG_MIN_HZ = 10.0
WATCHDOG_MAX_HZ = 50.0  # [Hz] the arm moves on for 100 ms; a delay of 20 ms trips it
DEAD_MAN_MIN_S = 0.02
DEAD_MAN_MAX_S = 0.2  # [s] five heartbeats; the arm moves on for as long when nobody is left
PACE_MIN = 0.1
PACE_MAX = 2.0  # [-] range of an approach; above it is a throw
SWITCH = {"on": True, "off": False}


@dataclass(frozen=True)
class ExecutorSettings:
    """Settings of one executor.

    Attributes:
        cell: name of the cell.
        cells: folder of cell files.
        database_url: address of the store.
        data: folder of undelivered results and of a latched fault.
        read_only: connect and report, never move.
        watchdog_hz: lowest command rate accepted by the controller [Hz]; None: chosen by real-time permission.
        dead_man_s: time without a heartbeat after which a program in the controller stops the arm [s].
        core: processor of the streaming process; -1: any.
        keep_awake: keep that processor from sleeping during an execution.
        approach_pace: pace of the approach to the plan's start [-]; 2 takes half as long as 1.
        must_be_proven: whether the verifier has to prove a plan, too, before it is made.

    Raises:
        ValueError: a value out of its range.
    """

    cell: str
    cells: Path
    database_url: str
    data: Path
    read_only: bool = False
    watchdog_hz: float | None = None
    dead_man_s: float = 0.04
    core: int = realtime.ANY_CORE
    keep_awake: bool = True
    approach_pace: float = 1.0
    must_be_proven: bool = False

    def __post_init__(self) -> None:
        if self.watchdog_hz is not None and not WATCHDOG_MIN_HZ <= self.watchdog_hz <= WATCHDOG_MAX_HZ:
            raise ValueError(
                f"FLING_WATCHDOG_HZ {self.watchdog_hz:g} is not within {WATCHDOG_MIN_HZ:g} and {WATCHDOG_MAX_HZ:g} Hz"
            )
        if not DEAD_MAN_MIN_S <= self.dead_man_s <= DEAD_MAN_MAX_S:
            raise ValueError(
                f"FLING_DEAD_MAN_S {self.dead_man_s:g} is not within {DEAD_MAN_MIN_S:g} and {DEAD_MAN_MAX_S:g} s"
            )
        if not PACE_MIN <= self.approach_pace <= PACE_MAX:
            raise ValueError(f"FLING_APPROACH_PACE {self.approach_pace:g} is not within {PACE_MIN:g} and {PACE_MAX:g}")

    @property
    def cell_path(self) -> Path:
        """Path of the cell file."""
        return self.cells / f"{self.cell}.toml"

    @classmethod
    def from_environment(cls, environment: Mapping[str, str], cell: str | None, read_only: bool) -> ExecutorSettings:
        """Returns the settings of `environment`; `cell` overrides FLING_DEFAULT_CELL.

        Raises:
            ValueError: a value that cannot be read, or is out of its range.
        """
        name = cell or environment.get("FLING_DEFAULT_CELL", "ur5e-sim")
        return cls(
            cell=name,
            cells=Path(environment.get("FLING_CELLS") or default_cells_folder()),
            database_url=this_machine.database_url(environment),
            data=stop_socket.executor_folder(this_machine.executors_folder(environment), name),
            read_only=read_only,
            watchdog_hz=_number(environment, "FLING_WATCHDOG_HZ") if environment.get("FLING_WATCHDOG_HZ") else None,
            dead_man_s=_number(environment, "FLING_DEAD_MAN_S", "0.04"),
            core=realtime.default_core(environment),
            keep_awake=_switch(environment, "FLING_KEEP_AWAKE"),
            approach_pace=_number(environment, "FLING_APPROACH_PACE", "1"),
            must_be_proven=_switch(environment, "FLING_VERIFY", "off"),
        )


def _number(environment: Mapping[str, str], name: str, default: str = "") -> float:
    """Returns the value of a variable that is a number."""
    text = environment.get(name) or default
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} {text!r} is not a number") from None


def _switch(environment: Mapping[str, str], name: str, default: str = "on") -> bool:
    """Returns the value of an on/off variable."""
    word = environment.get(name) or default
    if word not in SWITCH:
        raise ValueError(f"{name} {word!r} is neither 'on' nor 'off'")
    return SWITCH[word]
