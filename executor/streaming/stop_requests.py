"""Requests to stop from outside the loop: abort flag, SIGTERM, and a daemon that is frozen, dead or silent."""

from __future__ import annotations

import os
import signal
from time import monotonic
from types import FrameType

from executor.shared_memory import ABORT, DAEMON_PULSE, SharedMemory

FROZEN = b"tTZXx"  # thread states stopped, traced, dead; source: proc_pid_stat(5)
STAT_BYTES = 256  # the state follows the name, of 16 bytes at most


class StopRequests:
    """Reads the abort flag, the signals and the state of the daemon; a signal only sets a flag."""

    def __init__(self, memory: SharedMemory, daemon_silent_s: float, daemon: int, thread: int) -> None:
        """Opens the state of the daemon's pulse thread.

        Args:
            memory: shared with the daemon.
            daemon_silent_s: longest accepted silence of the daemon [s].
            daemon, thread: process and thread that write the pulse; a frozen one is noticed at the next tick.
        """
        self.fields, self.daemon_silent_s = memory.fields, daemon_silent_s
        self.terminated = False
        self._stat = os.open(f"/proc/{daemon}/task/{thread}/stat", os.O_RDONLY)

    def listen(self) -> None:
        """Makes SIGTERM a request to stop from now on; ignores SIGINT."""
        signal.signal(signal.SIGTERM, self._terminate)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the daemon, which aborts in order

    def pending(self) -> tuple[str, str] | None:
        """Returns outcome and reason of a request to stop; None without one."""
        if self.fields[ABORT]:
            return "aborted", "abort requested"
        if self.terminated:
            return "executor_lost", "the executor ended"
        if self._is_daemon_frozen():
            return "executor_lost", "the executor was frozen"
        if monotonic() - self.fields[DAEMON_PULSE] > self.daemon_silent_s:
            return "executor_lost", f"the executor was silent for {self.daemon_silent_s * 1e3:.0f} ms"
        return None

    def _is_daemon_frozen(self) -> bool:
        try:
            stat = os.pread(self._stat, STAT_BYTES, 0)
        except ProcessLookupError:
            return True  # dead and reaped
        return stat[stat.rindex(b")") + 2] in FROZEN

    def _terminate(self, number: int, frame: FrameType | None) -> None:
        self.terminated = True
