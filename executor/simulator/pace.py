"""The pace: when the next cycle is due. Where this machine stands still, controller time does too.

Cycles lie on an absolute grid of the monotonic clock, and a wake-up that is a little late does not move it. But a
machine that stalls for longer (a virtual one whose host has taken its processor, a process that was stopped) would owe
cycles, and running them at once is what no controller does: it is punctual, and gives a client time to answer every
state. So the grid slips by what is overdue. Timestamps go on by one cycle time a cycle, whatever the slips.

The simulator is meant to have the highest priority of its processor. Then nothing that a client does makes it late, so
where it is late the machine has stalled, and a client that has not answered yet is given RECOVERY_CYCLES from now. To
see a stall between two cycles as well, the loop wakes up at least BEAT_SHARE of a cycle after it has gone to sleep. At
ordinary priority being late is usual and tells nothing: nothing is given beyond what is overdue.
"""

from __future__ import annotations

from executor.simulator.statistics import Lateness, Slips

BEAT_SHARE = 0.25  # [-] of a cycle: longest sleep; when a stall began is known to within this
SLIP_SHARE = 0.4  # [-] of a cycle that may be lost; at 500 Hz 1.2 ms are left to a client, and ours needs 0.5 ms
RECOVERY_CYCLES = 2.0  # after a slip; a machine that has stalled is slow for a while: ticks took five times as long


class Pace:
    """The grid of due times, and what happened to it.

    Attributes:
        due: when the next cycle begins [s, monotonic].
        lost: of this cycle so far: until its state was sent, and in wake-ups that came late [s].
        lateness: of the beginnings of cycles.
        slips: of the grid.
        is_real_time: whether being late means that the machine has stalled.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.is_real_time = False
        self.due = self.wake = self.lost = 0.0
        self.lateness, self.slips = Lateness(), Slips()

    def start(self, now: float) -> None:
        """Begins a grid anew: the next cycle is one cycle time away."""
        self.due, self.lost = now + self.dt, 0.0

    def rest(self, now: float) -> float:
        """Returns how long to sleep from now on [s]."""
        self.wake = max(now, min(self.due, now + BEAT_SHARE * self.dt))
        return self.wake - now

    def woke(self, now: float, awaits_answer: bool) -> None:
        """Takes note of the end of the sleep, and of whether a client that streams still owes an answer."""
        self.lost += max(now - self.wake, 0.0)
        if self.lost > SLIP_SHARE * self.dt:
            self._slip(now + RECOVERY_CYCLES * self.dt if awaits_answer and self.is_real_time else now)

    def begins(self, now: float) -> None:
        """A cycle begins."""
        self.lateness.add(now - self.due)

    def told(self, now: float) -> None:
        """The cycle's state was sent."""
        self.lost = now - self.due
        self.due += self.dt
        if self.lost > SLIP_SHARE * self.dt:
            self._slip(now + self.dt * (RECOVERY_CYCLES if self.is_real_time else 1.0 - SLIP_SHARE))

    def _slip(self, due: float) -> None:
        """Moves the grid, never back."""
        if due > self.due:
            self.slips.add(due - self.due)
            self.due = due
        self.lost = 0.0
