"""A child process whose end is noticed at once, and which is seen when somebody has frozen it."""

from __future__ import annotations

import os
import select
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)  # ends that no library brings about


class Child:
    """One child process."""

    def __init__(self, command: Sequence[str], descriptors: Sequence[int], log: Path) -> None:
        """Starts `command` with `descriptors` inherited; what it says goes into the file `log`.

        Raises:
            OSError: it cannot be started.
        """
        self.log = log
        with log.open("wb") as stream:  # a file: a pipe that nobody reads would one day stop the child
            self._process = subprocess.Popen(
                command, pass_fds=descriptors, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream
            )
        try:
            self._descriptor = os.pidfd_open(self._process.pid)
        except OSError:  # a kernel before 5.3: a child whose end nobody would notice must not live
            self._process.kill()
            self._process.wait()
            raise
        self._end = select.poll()
        self._end.register(self._descriptor, select.POLLIN)

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def code(self) -> int | None:
        """How it ended; None while it has not."""
        return self._process.poll()

    @property
    def ended_from_outside(self) -> bool:
        """Whether a signal ended it that no library raises."""
        return self.code in FROM_OUTSIDE

    def ends_within(self, duration_s: float) -> bool:
        """Waits for its end, so long at most; returns at once when it comes."""
        return bool(self._end.poll(1e3 * duration_s))

    def is_frozen(self) -> bool:
        """Whether a signal has stopped it (SIGSTOP)."""
        try:
            return os.waitid(os.P_PID, self.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
        except ChildProcessError:
            return False  # it has ended, and was reaped

    def last_words(self) -> list[str]:
        """Returns the last line of what it said, if there is one."""
        return self.log.read_text(errors="replace").strip().splitlines()[-1:]

    def kill(self) -> None:
        """Ends it by SIGKILL, frozen or not; does not wait."""
        self._process.kill()

    def reap(self) -> None:
        """Waits for its end, so that it leaves nothing behind."""
        self._process.wait()
        os.close(self._descriptor)
