"""Progress of the search for a plan, told to an observer. It decides nothing: the answer is the same without one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Stage = Literal["queued", "search", "nearest"]


@dataclass(frozen=True)
class Progress:
    """What the search for a plan has come to.

    Attributes:
        stage: `search` for what was asked; `nearest` for something near it, after that was refused; `queued` in line at
            a service.
        candidates: release states tried so far, in all searches for this plan.
        best_release_time_s: soonest certified release of the running search [s]; None without any, and in `nearest`.
        elapsed_s: since the search began [s].
    """

    stage: Stage
    candidates: int
    best_release_time_s: float | None
    elapsed_s: float


Observer = Callable[[Progress], object]


class ProgressMeter:
    """Counts what is tried for one plan, which may take several searches, and tells an observer.

    Args:
        observer: called after each step; what it raises ends the search, and leaves the planner as it is. None: nobody.
    """

    def __init__(self, observer: Observer | None = None) -> None:
        self._observer = observer
        self._begun_s = time.perf_counter()
        self._stage: Stage = "search"
        self._candidates = 0

    def begin(self, stage: Stage) -> None:
        """Notes what is searched for from now on."""
        self._stage = stage
        self.step(0, math.inf)

    def step(self, candidates: int, release_time_s: float) -> None:
        """Tells of a step.

        Args:
            candidates: that it begins with.
            release_time_s: soonest certified release of this search [s]; infinite without any.
        """
        if self._observer is None:
            return
        self._candidates += candidates
        best_s = release_time_s if math.isfinite(release_time_s) and self._stage == "search" else None
        self._observer(Progress(self._stage, self._candidates, best_s, time.perf_counter() - self._begun_s))


SILENT = ProgressMeter()
