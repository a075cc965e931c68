"""Recordings of commanded and measured joint velocity, from a telemetry table or a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array

JOINTS = 6
COMMANDS = tuple(f"command_{i}" for i in range(JOINTS))
MEASUREMENTS = tuple(f"measured_{i}" for i in range(JOINTS))
COLUMNS = ("time_s", *COMMANDS, *MEASUREMENTS)
ROWS_MIN = 20  # rows below which no lag can be told from noise
RECORDING_BYTES = 10_000_000  # [byte] of a CSV file: more than `TICKS_MAX` rows
TICK_MIN_S = 0.0005  # [s] of two rows: controllers have 500 or 125 ticks a second; catches times in milliseconds
TICK_MAX_S = 0.1  # [s] lags are shorter
TICKS_MAX = 10_000  # [ticks] from first to last row: 20 s at 500 Hz; rows that are missing are filled in
SPEED_MAX_RAD_S = 100.0  # [rad/s] far above any joint's; catches other units
GAP = 1.5  # [ticks] a longer time between two rows means that rows are missing


class RecordingError(ValueError):
    """A recording cannot be used; the text says why."""


@dataclass(frozen=True, eq=False)
class MotionRecording:
    """Joint velocities of one motion.

    Attributes:
        time_s: times of the rows (n,) [s], increasing; a command was sent at the time of its row.
        command: commanded joint velocities (n, 6) [rad/s].
        measured: measured joint velocities (n, 6) [rad/s].

    Raises:
        RecordingError: too few rows, numbers that are not finite, times that do not increase.
    """

    time_s: Array
    command: Array
    measured: Array

    def __post_init__(self) -> None:
        if len(self.time_s) < ROWS_MIN:
            raise RecordingError(f"{len(self.time_s)} rows: a lag needs {ROWS_MIN} at least")
        for name in ("time_s", "command", "measured"):
            if not np.isfinite(getattr(self, name)).all():
                raise RecordingError(f"{name} holds numbers that are not finite")
        late = np.flatnonzero(np.diff(self.time_s) <= 0.0)
        if len(late):
            raise RecordingError(f"time_s does not increase at row {int(late[0]) + 1}")
        self._check_sizes()

    def _check_sizes(self) -> None:
        if not TICK_MIN_S <= self.dt <= TICK_MAX_S:
            raise RecordingError(f"the rows are {self.dt:.3g} s apart, not {TICK_MIN_S:g} to {TICK_MAX_S:g} s")
        ticks = float(self.time_s[-1] - self.time_s[0]) / self.dt
        if ticks > TICKS_MAX:
            raise RecordingError(f"time_s spans {ticks:.6g} ticks of {self.dt:.3g} s; there may be {TICKS_MAX}")
        for name in ("command", "measured"):
            fastest = float(np.abs(getattr(self, name)).max())
            if fastest > SPEED_MAX_RAD_S:
                raise RecordingError(f"{name} reaches {fastest:.4g} rad/s; no joint is faster than {SPEED_MAX_RAD_S:g}")

    @property
    def dt(self) -> float:
        """One tick [s]: the median time between two rows."""
        return float(np.median(np.diff(self.time_s)))

    def held_commands(self) -> tuple[Array, Array]:
        """Returns times (m,) [s] and commands (m, 6) [rad/s] with the rows that are missing filled in.

        A controller that gets no command keeps the one before; so a gap ends with that command one tick before the
        next.
        """
        gaps = np.flatnonzero(np.diff(self.time_s) > GAP * self.dt)
        times = np.insert(self.time_s, gaps + 1, self.time_s[gaps + 1] - self.dt)
        return times, np.insert(self.command, gaps + 1, self.command[gaps], axis=0)


def recording_from_csv(text: str) -> MotionRecording:
    """Returns the recording of a CSV text with the columns `COLUMNS`, in any order; others are ignored.

    Raises:
        RecordingError: a column is missing, a field is not a number, or the rows cannot be used.
    """
    try:
        table = _table(csv.reader(io.StringIO(text)))
    except csv.Error as error:  # a field of more than 131,072 characters
        raise RecordingError(f"is not CSV: {error}") from error
    return MotionRecording(table[:, 0], table[:, 1 : 1 + JOINTS], table[:, 1 + JOINTS :])


def _table(rows: Iterator[list[str]]) -> Array:
    """Returns the columns `COLUMNS` (n, 13) of a header and its rows."""
    header = [name.strip() for name in next(rows, [])]
    for name in COLUMNS:
        if header.count(name) != 1:
            raise RecordingError(f"the header has {'no' if name not in header else 'more than one'} column {name}")
    at = [header.index(name) for name in COLUMNS]
    numbers = [_numbers(row, at, i) for i, row in enumerate(rows, start=2) if row]
    return np.array(numbers).reshape(-1, len(COLUMNS))


def _numbers(row: list[str], at: list[int], line: int) -> list[float]:
    try:
        return [float(row[i]) for i in at]
    except (ValueError, IndexError) as error:
        raise RecordingError(f"line {line}: {str(error)[:100]}") from error
