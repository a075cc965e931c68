"""Orders from outside the loop: abort, SIGTERM, a daemon that is frozen, gone or silent."""

from __future__ import annotations

import os
import signal
from time import monotonic
from types import FrameType

from executor.board import ABORT, DAEMON_PULSE, Board

FROZEN = b"tTZXx"  # states of a thread that runs no more: stopped, traced, dead; source: proc_pid_stat(5)
STAT_BYTES = 256  # the state stands behind the name, which is 16 bytes at most


class Orders:
    """Looks at the board, at the signals, and at the daemon's thread; a signal only sets a flag."""

    def __init__(self, board: Board, daemon_silent_s: float, daemon: int, thread: int) -> None:
        """After `daemon_silent_s` [s] without its pulse the daemon counts as gone.

        Args:
            board: shared with the daemon.
            daemon_silent_s: bound of its silence [s].
            daemon, thread: process and thread that gives the pulse: frozen, it is seen at the next tick.
        """
        self.words, self.daemon_silent_s = board.words, daemon_silent_s
        self.terminated = False
        self._stat = os.open(f"/proc/{daemon}/task/{thread}/stat", os.O_RDONLY)

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
        if self._daemon_is_frozen():
            return "executor_lost", "the executor was frozen"
        if monotonic() - self.words[DAEMON_PULSE] > self.daemon_silent_s:
            return "executor_lost", f"the executor was silent for {self.daemon_silent_s * 1e3:.0f} ms"
        return None

    def _daemon_is_frozen(self) -> bool:
        try:
            stat = os.pread(self._stat, STAT_BYTES, 0)
        except ProcessLookupError:
            return True  # dead, and reaped
        return stat[stat.rindex(b")") + 2] in FROZEN

    def _terminate(self, number: int, frame: FrameType | None) -> None:
        self.terminated = True
