"""Pace of the controller cycles in real time: the grid of due times, and its slips where the machine stalls.

Cycles lie on an absolute grid of the monotonic clock. A slightly late wake-up does not move the grid. After a stall (a
virtual machine whose host takes its processor away, a stopped process) cycles are overdue. They are not run in a burst:
a real controller is punctual and leaves a client time to answer every state. Instead the grid slips by the overdue
time. Timestamps still advance by one cycle time per cycle.

With the highest real-time priority of its processor, nothing a client does makes the simulator late. A late simulator
then means that the machine has stalled, and a client that has not answered yet gets RECOVERY_CYCLES from now. To detect
stalls between two cycles, the loop sleeps for BEAT_SHARE of a cycle at most. At ordinary priority, lateness is common
and proves nothing: the grid slips by the overdue time alone.

All of this serves machines that stall. `stall_tolerant=False` switches it off: a strict grid, overdue cycles run at
once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

BEAT_SHARE = 0.25  # [-] of a cycle: longest sleep, hence the uncertainty of when a stall began
SLIP_SHARE = 0.4  # [-] of a cycle that may be lost; at 500 Hz 1.2 ms are left to a client, and ours needs 0.5 ms
RECOVERY_CYCLES = 2.0  # [cycles] after a slip; a machine is slow after a stall: cycles took five times as long


class LatenessHistogram:
    """Histogram of the delay between the due time of a cycle and its beginning."""

    BIN_S = 2e-6
    BINS = 50_000  # up to 100 ms; longer delays are counted in the last bin

    def __init__(self) -> None:
        self.counts = [0] * self.BINS
        self.cycles = 0
        self.largest = 0.0

    def add(self, late_s: float) -> None:
        """Counts the delay [s] of one cycle."""
        self.cycles += 1
        self.counts[min(int(max(late_s, 0.0) / self.BIN_S), self.BINS - 1)] += 1
        self.largest = max(self.largest, late_s)

    def quantile(self, share: float) -> float:
        """Returns the delay [s] not exceeded by a share of the cycles, rounded up to a bin."""
        wanted = share * self.cycles
        return next(bin for bin, seen in enumerate(accumulate(self.counts), 1) if seen >= wanted) * self.BIN_S

    def as_document(self) -> dict[str, Any]:
        """Returns the number of cycles and the percentiles of their delay."""
        return {
            "ticks": self.cycles,
            "p50_s": self.quantile(0.5),
            "p99_s": self.quantile(0.99),
            "p999_s": self.quantile(0.999),
            "max_s": self.largest,
        }


@dataclass
class SlipCounts:
    """Counts how often, and for how long, controller time stood still because the machine did."""

    count: int = 0
    total_s: float = 0.0
    max_s: float = 0.0

    def add(self, duration_s: float) -> None:
        """Counts one slip."""
        self.count += 1
        self.total_s += duration_s
        self.max_s = max(self.max_s, duration_s)


class CyclePacing:
    """Grid of due times of the controller cycles.

    Attributes:
        due: beginning of the next cycle [s, monotonic].
        lost: time lost in this cycle so far, in computing its state and in late wake-ups [s].
        lateness: delays of the beginnings of cycles.
        slips: slips of the grid.
        is_real_time: whether lateness means that the machine has stalled.
    """

    def __init__(self, dt: float, stall_tolerant: bool = True) -> None:
        self.dt = dt
        self.sleep_max = BEAT_SHARE * dt if stall_tolerant else math.inf
        self.lost_max = SLIP_SHARE * dt if stall_tolerant else math.inf
        self.is_real_time = False
        self.due = self.wake = self.lost = 0.0
        self.lateness, self.slips = LatenessHistogram(), SlipCounts()

    def start(self, now: float) -> None:
        """Starts a new grid; the next cycle is one cycle time away."""
        self.due = now + self.dt
        self.lost = 0.0

    def sleep_s(self, now: float) -> float:
        """Returns the duration of the next sleep [s]."""
        self.wake = max(now, min(self.due, now + self.sleep_max))
        return self.wake - now

    def woke(self, now: float, awaits_answer: bool) -> None:
        """Registers the end of a sleep, and whether a streaming client still owes an answer."""
        self.lost += max(now - self.wake, 0.0)
        if self.lost > self.lost_max:
            self._slip(now + RECOVERY_CYCLES * self.dt if awaits_answer and self.is_real_time else now)

    def cycle_begun(self, now: float) -> None:
        """Registers the beginning of a cycle."""
        self.lateness.add(now - self.due)

    def state_sent(self, now: float) -> None:
        """Registers that the state of the cycle was sent."""
        self.lost = now - self.due
        self.due += self.dt
        if self.lost > self.lost_max:
            self._slip(now + self.dt * (RECOVERY_CYCLES if self.is_real_time else 1.0 - SLIP_SHARE))

    def _slip(self, due: float) -> None:
        """Moves the grid forwards, never back."""
        if due > self.due:
            self.slips.add(due - self.due)
            self.due = due
        self.lost = 0.0
