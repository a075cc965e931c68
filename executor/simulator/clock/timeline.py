"""Controller time, and the events noted on it."""

from __future__ import annotations

from collections import deque

EVENTS_MAX = 500  # events kept


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
