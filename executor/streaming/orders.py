"""Orders from outside the loop: abort, SIGTERM, a daemon that has gone silent."""

from __future__ import annotations

import signal
from time import monotonic
from types import FrameType

from executor.board import ABORT, DAEMON_PULSE, Board


class Orders:
    """Looks at the board and at the signals; a signal only sets a flag."""

    def __init__(self, board: Board, daemon_silent_s: float) -> None:
        """After `daemon_silent_s` [s] without its pulse the daemon counts as gone."""
        self.words, self.daemon_silent_s = board.words, daemon_silent_s
        self.terminated = False

    def listen(self) -> None:
        """From now on SIGTERM and SIGINT brake instead of killing."""
        signal.signal(signal.SIGTERM, self._terminate)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the daemon, which aborts in order

    def stop(self) -> tuple[str, str] | None:
        """Returns outcome and reason where the run must end, None where it may go on."""
        if self.words[ABORT]:
            return "aborted", "abort requested"
        if self.terminated:
            return "executor_lost", "the executor ended"
        if monotonic() - self.words[DAEMON_PULSE] > self.daemon_silent_s:
            return "executor_lost", f"the executor was silent for {self.daemon_silent_s * 1e3:.0f} ms"
        return None

    def _terminate(self, number: int, frame: FrameType | None) -> None:
        self.terminated = True
