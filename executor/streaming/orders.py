"""Orders from outside the loop: abort, SIGTERM, a daemon that has gone silent."""

from __future__ import annotations

import signal
from time import monotonic
from types import FrameType

from executor.board import ABORT, DAEMON_PULSE, Board

DAEMON_SILENT_S = 0.100  # [s] without a pulse nobody supervises this run any more; the daemon's period is 5 ms


class Orders:
    """Looks at the board and at the signals; a signal only sets a flag."""

    def __init__(self, board: Board) -> None:
        self.words = board.words
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
        if monotonic() - self.words[DAEMON_PULSE] > DAEMON_SILENT_S:
            return "executor_lost", f"the executor was silent for {DAEMON_SILENT_S * 1e3:.0f} ms"
        return None

    def _terminate(self, number: int, frame: FrameType | None) -> None:
        self.terminated = True
