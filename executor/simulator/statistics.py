"""Counts that tell the truth about a client's streaming, and about this controller's own timing."""

from __future__ import annotations

from typing import Any

STREAMING = frozenset({9, 10, 11, 24})  # speedJ, speedL, servoJ, servoL
IDLE = 0  # clears the command register, and kicks the watchdog: neither a command nor the end of a stream


class Commands:
    """How many fresh streaming commands every cycle brought, while a client streams.

    A stream begins with the first cycle that brings a streaming command, and ends with another command or the program.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Starts counting anew."""
        self.fresh = 0
        self.streaming = False
        self.cycles_with_none = self.cycles_with_one = self.cycles_with_more = 0
        self.longest_gap = self.gap = 0

    @property
    def awaits_answer(self) -> bool:
        """Whether a client streams and this cycle has brought no command yet."""
        return self.streaming and self.fresh == 0

    def arrived(self, command: int) -> None:
        """Takes note of a command number that a package brought."""
        if command in STREAMING:
            self.fresh += 1
            self.streaming = True
        elif command != IDLE:
            self.ended()

    def ended(self) -> None:
        """The stream is over."""
        self.streaming = False
        self.fresh = self.gap = 0

    def cycle(self) -> None:
        """Counts the cycle that begins now."""
        if not self.streaming:
            return
        if self.fresh == 0:
            self.cycles_with_none += 1
            self.gap += 1
            self.longest_gap = max(self.longest_gap, self.gap)
        else:
            self.gap = 0
            self.cycles_with_one += self.fresh == 1
            self.cycles_with_more += self.fresh > 1
        self.fresh = 0

    def as_document(self) -> dict[str, Any]:
        """Returns the counts."""
        return {
            "none": self.cycles_with_none,
            "one": self.cycles_with_one,
            "more": self.cycles_with_more,
            "longest_gap_cycles": self.longest_gap,
        }


class Lateness:
    """How late each tick of the loop began after its due time: a histogram of microseconds."""

    BIN_S = 2e-6
    BINS = 50_000  # up to 100 ms; later ticks count in the last bin

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Starts counting anew."""
        self.counts = [0] * self.BINS
        self.ticks = 0
        self.largest = 0.0

    def add(self, late_s: float) -> None:
        """Counts one tick."""
        self.ticks += 1
        self.counts[min(int(max(late_s, 0.0) / self.BIN_S), self.BINS - 1)] += 1
        self.largest = max(self.largest, late_s)

    def quantile(self, part: float) -> float:
        """Returns the lateness [s] that `part` of the ticks did not exceed, rounded up to a bin."""
        wanted, seen = part * self.ticks, 0
        for i, count in enumerate(self.counts):
            seen += count
            if seen >= wanted:
                return (i + 1) * self.BIN_S
        return self.largest

    def as_document(self) -> dict[str, Any]:
        """Returns count and percentiles."""
        return {
            "ticks": self.ticks,
            "p50_s": self.quantile(0.5),
            "p99_s": self.quantile(0.99),
            "p999_s": self.quantile(0.999),
            "max_s": self.largest,
        }


class Slips:
    """How often, and for how long, controller time stood still because this machine did."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Starts counting anew."""
        self.count = 0
        self.total = self.largest = 0.0

    def add(self, duration_s: float) -> None:
        """Counts one slip."""
        self.count += 1
        self.total += duration_s
        self.largest = max(self.largest, duration_s)

    def as_document(self) -> dict[str, Any]:
        """Returns the counts."""
        return {"count": self.count, "total_s": self.total, "max_s": self.largest}
