"""The schedule: what to send at each tick, the plan's rows or, once diverted, the certified brake."""

from __future__ import annotations

from executor.job import Job, Row
from planner.brake_profile import brake_weights


class Schedule:
    """Rows by tick, before and after a diversion.

    Attributes:
        last: the row after which everything is at rest.
        diverted: the row from which the brake is flown; None on the plan.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self.last = len(job.q) - 1
        self.diverted: int | None = None
        self.brake_s = 0.0

    def divert(self, row: int) -> None:
        """Brakes from the first row not before `row` from which the brake is certified."""
        if self.diverted is not None:
            return
        job = self.job
        start = job.brake_row[min(row, self.last)]
        self.diverted = start
        self.brake_s = job.brake_ticks[start] * job.dt
        self.last = start + job.brake_ticks[start] + int(job.lag_ticks) + 2

    def command(self, row: int) -> tuple[Row, Row]:
        """Returns q and qd (6,) to be reached one lag after row `row` is sent."""
        row = min(row, self.last)
        if self.diverted is None or row <= self.diverted:
            return self.job.q[row], self.job.qd[row]
        return self._braking((row - self.diverted) * self.job.dt)

    def reference(self, row: int) -> tuple[Row, Row]:
        """Returns q and qd (6,) that should be measured when row `row` is sent."""
        if self.diverted is None or row - self.job.lag_ticks <= self.diverted:
            row = min(row, len(self.job.q) - 1)
            return self.job.reference_q[row], self.job.reference_qd[row]
        return self._braking((row - self.job.lag_ticks - self.diverted) * self.job.dt)

    def _braking(self, s: float) -> tuple[Row, Row]:
        start = self.diverted or 0
        T = self.brake_s
        way, bend, speed, lift, _, _ = brake_weights(s / T if T > 0.0 else 1.0)
        q0, qd0, qdd0 = self.job.q[start], self.job.qd[start], self.job.qdd[start]
        q = [x + T * (way * v + T * bend * a) for x, v, a in zip(q0, qd0, qdd0, strict=True)]
        return q, [speed * v + T * lift * a for v, a in zip(qd0, qdd0, strict=True)]
