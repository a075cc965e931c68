"""Counts of a client's commands per cycle and of this process's own timing."""

from __future__ import annotations

from typing import Any

STREAMING = frozenset({9, 10, 11, 24})  # command numbers of speedJ, speedL, servoJ, servoL
NO_COMMAND = 0  # clears the command register or resets the watchdog; does not end a stream


class StreamCounts:
    """Counts the fresh streaming commands of every cycle while a client streams.

    A stream begins with the first cycle that brings a streaming command. It ends with any other command or with the
    program.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restarts all counts."""
        self.fresh = 0
        self.streaming = False
        self.cycles_with_none = self.cycles_with_one = self.cycles_with_more = 0
        self.longest_gap = self.gap = 0

    @property
    def awaits_answer(self) -> bool:
        """Whether a client streams but has sent no command for this cycle yet."""
        return self.streaming and self.fresh == 0

    def command_arrived(self, command: int) -> None:
        """Registers the command number of a data package."""
        if command in STREAMING:
            self.fresh += 1
            self.streaming = True
        elif command != NO_COMMAND:
            self.stream_ended()

    def stream_ended(self) -> None:
        """Ends the stream."""
        self.streaming = False
        self.fresh = self.gap = 0

    def cycle(self) -> None:
        """Counts the commands received before the cycle that begins now."""
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


class LatenessHistogram:
    """Histogram of the delay between the due time of a cycle and its beginning."""

    BIN_S = 2e-6
    BINS = 50_000  # up to 100 ms; longer delays are counted in the last bin

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restarts all counts."""
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
        wanted, seen = share * self.cycles, 0
        for i, count in enumerate(self.counts):
            seen += count
            if seen >= wanted:
                return (i + 1) * self.BIN_S
        return self.largest

    def as_document(self) -> dict[str, Any]:
        """Returns the number of cycles and the percentiles of their delay."""
        return {
            "ticks": self.cycles,
            "p50_s": self.quantile(0.5),
            "p99_s": self.quantile(0.99),
            "p999_s": self.quantile(0.999),
            "max_s": self.largest,
        }


class SlipCounts:
    """Counts how often, and for how long, controller time stood still because the machine did."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restarts all counts."""
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
