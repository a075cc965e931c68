"""How far ahead of a running motion a plan that is to replace it begins."""

from __future__ import annotations

import math
from collections import deque

FIRST_S = 0.5  # [s] before anything was measured: enough on a quiet machine (docs/how-to/replace.md)
KEPT = 20  # durations; they follow a machine that becomes busy, or quiet again
SHARE = 0.9  # of them that the lead is enough for: one in ten needs a second attempt, and none waits for the slowest


class Leads:
    """The time from asking where a motion is to the executor's answer, as measured in the last calls, by cell."""

    def __init__(self) -> None:
        self._taken: dict[str, deque[float]] = {}

    def lead_s(self, cell: str) -> float:
        """Returns the lead for the next call [s]: enough for nine in ten of the last twenty."""
        taken = sorted(self._of(cell))
        return taken[math.ceil(SHARE * len(taken)) - 1]

    def note(self, cell: str, taken_s: float) -> None:
        """Notes how long a call took [s]."""
        self._of(cell).append(taken_s)

    def shorten(self, cell: str) -> None:
        """Forgets the longest call, as a motion ended before its lead: one slow call must not keep others out."""
        taken = self._of(cell)
        taken.remove(max(taken))
        if not taken:
            taken.append(FIRST_S)

    def _of(self, cell: str) -> deque[float]:
        return self._taken.setdefault(cell, deque([FIRST_S], KEPT))
