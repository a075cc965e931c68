"""Telemetry of one run: its rows as named columns, and how the run ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.shared_memory import SCALARS, VECTORS
from planner.controller_program import SwitchRow

Vector = NDArray[np.float64]

UNITS = {"planned_q": "rad", "planned_qd": "rad_s", "command": "sent", "q": "rad", "qd": "rad_s", "current": "a"}


@dataclass(frozen=True, eq=False)
class RunResult:
    """End of one run of the streaming process.

    Attributes:
        outcome: one of `executor.stream_job.OUTCOMES`.
        reason: explanation for the operator.
        rows: telemetry (n, columns); see `executor.shared_memory`.
        missed: number of lost ticks.
        realtime: whether real-time scheduling and locked memory were granted.
        output_sent_s: plan time at which the gripper's output was sent [s]; None where it was not.
        output_late_s: delay of that against the plan [s].
        output_closed_s: plan time at which it was closed again [s]; None where it was not.
        stayed_closed: whether the gripper was seen not to open when it was told.
        moved_between: controller's times between which its fingers began to open [s]; NaN where it does not report it.
        grip_held: whether the gripper was seen to hold an object before the motion; None: nobody can tell.
        opened_again: whether the gripper had closed on nothing, and was opened again.
        timestamp_at_zero: the controller's time at plan time 0 [s].
        in_order: whether the process itself brought the arm to rest.
        switched_s: plan times at which the outputs of the passages were sent, in their order [s]; NaN for never.
        stop_levels: what a stop switched of them.
        stopped_s: plan time at which it did [s]; NaN for never.
        ready_at_s: when the arm stood at the plan's start, the gripper closed [s, monotonic]; None where it did not.
    """

    outcome: str
    reason: str
    rows: Vector
    missed: int
    realtime: bool
    output_sent_s: float | None
    output_late_s: float
    timestamp_at_zero: float
    in_order: bool
    output_closed_s: float | None = None
    stayed_closed: bool = False
    moved_between: tuple[float, float] = (math.nan, math.nan)
    grip_held: bool | None = None
    opened_again: bool = False
    switched_s: tuple[float, ...] = ()
    stop_levels: Sequence[SwitchRow] = ()
    stopped_s: float = math.nan
    ready_at_s: float | None = None


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Rows (n, columns) of one run, in the order of `executor.shared_memory`."""

    rows: Vector

    def __len__(self) -> int:
        return len(self.rows)

    def scalar(self, name: str) -> Vector:
        """Returns one scalar column (n,)."""
        return self.rows[:, SCALARS.index(name)]

    def vector(self, name: str) -> Vector:
        """Returns one vector column (n, 6)."""
        first = len(SCALARS) + 6 * VECTORS.index(name)
        return self.rows[:, first : first + 6]

    def at_clock(self, name: str, clock_s: float) -> Vector | None:
        """Returns a vector (6,) at a plan time [s], interpolated linearly; None outside the rows."""
        clock = self.scalar("clock_s")
        if len(clock) < 2 or not clock[0] <= clock_s <= clock[-1]:
            return None
        return np.array([np.interp(clock_s, clock, column) for column in self.vector(name).T])


def column_names() -> list[str]:
    """Returns the name of every column, with its unit."""
    vectors = [f"{name}_{joint}_{UNITS[name]}" for name in VECTORS for joint in range(6)]
    return [*SCALARS, *vectors]


def row_document(row: Vector) -> dict[str, Any]:
    """Returns the telemetry event of one row (columns,)."""
    telemetry = Telemetry(row[None])
    return {
        "clock_s": float(telemetry.scalar("clock_s")[0]),
        "positions": telemetry.vector("q")[0].tolist(),
        "velocities": telemetry.vector("qd")[0].tolist(),
        "planned_positions": telemetry.vector("planned_q")[0].tolist(),
        "planned_velocities": telemetry.vector("planned_qd")[0].tolist(),
        "missed_ticks": int(telemetry.scalar("missed_ticks")[0]),
    }
