"""Telemetry rows as named columns, for metrics, recording and the live view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.board import SCALARS, VECTORS

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Rows (n, columns) of one run, in the order of executor.board."""

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
        """Returns a vector (6,) at a time of the plan's clock, between rows by a straight line; None outside."""
        clock = self.scalar("clock_s")
        if len(clock) < 2 or not clock[0] <= clock_s <= clock[-1]:
            return None
        return np.array([np.interp(clock_s, clock, column) for column in self.vector(name).T])


def column_names() -> list[str]:
    """Returns the name of every column, unit included."""
    units = {"planned_q": "rad", "planned_qd": "rad_s", "command": "sent", "q": "rad", "qd": "rad_s", "current": "a"}
    vectors = [f"{name}_{joint}_{units[name]}" for name in VECTORS for joint in range(6)]
    return [*SCALARS, *vectors]
