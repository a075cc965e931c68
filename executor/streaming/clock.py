"""The clock: the controller's own timestamp. A tick begins when a new one arrives; lost ticks are counted."""

from __future__ import annotations

from time import monotonic, sleep

from executor.streaming.fault import LinkFault
from executor.streaming.link import Link

POLL_S = 50e-6  # [s] between two looks at the timestamp
EARLY_S = 400e-6  # [s] before the next timestamp is due, polling begins
STALE_S = 0.040  # [s] without a new timestamp the link counts as lost (faults.md, R10)
REALTIME_BOUNDS = (0.020, 0.10)  # [s] in a row, [-] share of the last hundred ticks; source: libfranka stops there
ORDINARY_BOUNDS = (0.040, 0.30)  # the same without real-time scheduling, which is for simulated cells
LINK_SHARE = REALTIME_BOUNDS[1]  # [-] of ticks lost while this thread had its processor, whatever its scheduling
OWN_GAP_S = 0.010  # [s] between two polls: then this process slept, and the timestamp's age says nothing


class Clock:
    """Counts ticks by the controller's time.

    Attributes:
        tick: whole ticks since the first timestamp.
        missed: ticks lost before this one.
        total_missed: all of them.
        host_s: when this tick's timestamp was seen, by the monotonic clock [s].
    """

    def __init__(self, link: Link, dt: float) -> None:
        self.link, self.dt = link, dt
        self.first = self.stamp = link.timestamp()
        self.tick = self.missed = self.total_missed = 0
        self.host_s = monotonic()

    def wait(self) -> None:
        """Returns at the next new timestamp.

        Raises:
            LinkFault: none came for too long, or time ran backwards.
        """
        rest = self.host_s + self.dt - EARLY_S - monotonic()
        if rest > 0.0:
            sleep(rest)
        begin = polled = monotonic()
        while (stamp := self.link.timestamp()) == self.stamp:
            sleep(POLL_S)
            now = monotonic()
            if now - polled > OWN_GAP_S:
                begin = now
            polled = now
            if now - begin > STALE_S:
                raise LinkFault("link_lost", f"no new state for {STALE_S * 1e3:.0f} ms")
        self.host_s = monotonic()
        self._count(stamp)

    def _count(self, stamp: float) -> None:
        tick = round((stamp - self.first) / self.dt)
        if tick <= self.tick:
            raise LinkFault("link_lost", "the controller's time ran backwards")
        self.missed = tick - self.tick - 1
        self.total_missed += self.missed
        self.tick, self.stamp = tick, stamp


class Lateness:
    """Judges lost ticks: too many in a row, too many of the recent ones, or too many that the link lost.

    Without real-time scheduling a busy machine delays this thread, and wide bounds apply to the ticks lost. A tick lost
    while the thread did not wait for a processor was lost by the link: for those the bound is the same everywhere, so
    that a bad link is noticed as early without real-time scheduling as with it.

    Attributes:
        in_a_row: so many lost in a row end the run.
        most: so many lost of the last hundred end the run.
        most_by_link: so many of them that the link lost end the run.
    """

    memory = 100  # [ticks]

    def __init__(self, dt: float, realtime: bool) -> None:
        """Without real-time scheduling gaps of a busy machine are borne twice as long, below the watchdog's 50 ms."""
        in_a_row_s, share = REALTIME_BOUNDS if realtime else ORDINARY_BOUNDS
        self.dt = dt
        self.in_a_row = max(3, round(in_a_row_s / dt))
        self.most, self.most_by_link = share * self.memory, LINK_SHARE * self.memory
        self.level = self.by_link = 0.0

    def too_late(self, missed: int, delayed_s: float) -> bool:
        """Returns whether the run must end.

        Args:
            missed: ticks lost before this one.
            delayed_s: time this thread waited for a processor since the tick before [s].
        """
        self.level += missed - self.level / self.memory
        self.by_link = max(0.0, self.by_link + missed - delayed_s / self.dt - self.by_link / self.memory)
        return missed >= self.in_a_row or self.level > self.most or self.by_link > self.most_by_link
