"""Controller time: its cycles, the events noted on it, and a client's commands counted cycle by cycle."""

from __future__ import annotations

from collections import deque

EVENTS_MAX = 500  # events kept
STREAMING = frozenset({9, 10, 11, 24})  # command numbers of speedJ, speedL, servoJ, servoL
NO_COMMAND = 0  # clears the command register or resets the watchdog; does not end a stream


class Timeline:
    """Counts controller cycles; it knows no wall clock.

    Attributes:
        dt: duration of a cycle [s].
        cycles: cycles begun since the start.
        events: (controller time [s], text) of the latest events.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.cycles = 0
        self.events: deque[tuple[float, str]] = deque(maxlen=EVENTS_MAX)

    @property
    def t(self) -> float:
        """Controller time [s]."""
        return self.cycles * self.dt

    def cycles_in(self, duration_s: float) -> int:
        """Returns the number of cycles closest to a duration [s]."""
        return round(duration_s / self.dt)

    def note(self, event: str) -> None:
        """Records an event at the present controller time."""
        self.events.append((round(self.t, 4), event))


class StreamCounts:
    """Counts the fresh streaming commands of every cycle while a client streams.

    A stream begins with the first cycle that brings a streaming command. It ends with any other command or with the
    program.

    Attributes:
        fresh: commands received for the next cycle.
        counts: cycles with `none`, `one` or `more` fresh commands, and the longest run of cycles without one.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restarts all counts."""
        self.counts = {"none": 0, "one": 0, "more": 0, "longest_gap_cycles": 0}
        self.stream_ended()

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
        self.counts["more" if self.fresh > 1 else "one" if self.fresh else "none"] += 1
        self.gap = 0 if self.fresh else self.gap + 1
        self.counts["longest_gap_cycles"] = max(self.counts["longest_gap_cycles"], self.gap)
        self.fresh = 0
