"""Whether the commands arrive: the controller publishes the joint speeds that it commands its arm itself."""

from __future__ import annotations

from collections import deque

RECENT = 3  # [ticks] in which a command shows in the controller's target: one to be taken over, two on the way
FOLLOWS_RAD_S = 1e-3  # [rad/s] far above rounding, far below what a launch changes in three ticks
KNOWN_AFTER = 20  # [ticks] of following before anything is concluded: a controller may publish another target


class CommandWatch:
    """Follows the controller's target speeds beside the speeds that were sent to it."""

    def __init__(self) -> None:
        self._recent: deque[list[float]] = deque(maxlen=RECENT)
        self._followed = 0
        self._followed_at = 0.0

    def sent(self, command: list[float]) -> None:
        """Notes joint speeds (6,) that were sent [rad/s]."""
        self._recent.append(command)

    def look(self, target: list[float], stamp: float) -> None:
        """Compares the controller's target speeds (6,) [rad/s] at its time `stamp` [s] with what was sent."""
        for command in self._recent:
            if max([abs(a - b) for a, b in zip(target, command, strict=True)]) < FOLLOWS_RAD_S:
                self._followed += 1
                self._followed_at = stamp
                return

    def lost_s(self, stamp: float) -> float:
        """Returns for how long the controller has not followed [s]; 0 where that cannot be told."""
        return stamp - self._followed_at if self._followed >= KNOWN_AFTER else 0.0
