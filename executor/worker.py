"""A thread of the daemon that is started again where an error ended it."""

from __future__ import annotations

import math
import sys
import threading
import time

from executor.logs import log

FIT_AFTER_S = 10.0  # [s] a thread that ran this long since it was started again counts as well
PAUSE_S = 1.0  # [s] between two starts of a thread that dies at once, such as one whose folder is gone
JOIN_S = 5.0  # [s] longest wait for a thread that was asked to end; it may be within a call of its own timeout


class Worker:
    """Work that goes on in a thread until `stop`, whatever happens to the thread.

    The daemon calls `revive` many times a second. A thread does not end without a trace: while `complaint` is not empty
    the executor moves nothing.

    Attributes:
        ended: set where the work is to end.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None  # that ended the thread
        self._cause: BaseException | None = None  # of its latest death
        self._died_at = -math.inf

    def run(self) -> None:
        """Does the work until `ended` is set; an error ends the thread."""
        raise NotImplementedError

    def start(self) -> None:
        """Starts the thread."""
        self._thread = threading.Thread(target=self._work, name=self.name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Asks for the end and waits for it."""
        self.ended.set()
        if self._thread is not None:
            self._thread.join(JOIN_S)

    def revive(self) -> None:
        """Starts the thread again where it has died."""
        if not self._is_dead() or time.monotonic() - self._died_at < PAUSE_S:
            return
        self._died_at = time.monotonic()
        log("a thread died and is started again", thread=self.name, error=repr(self._error))
        self.start()

    def complaint(self) -> str:
        """Returns why the executor is not fit because of this thread; empty where it is."""
        if not self._is_dead() and time.monotonic() - self._died_at > FIT_AFTER_S:
            return ""
        return f"the executor is not fit: its {self.name} died a moment ago of {self._cause!r}"

    def _is_dead(self) -> bool:
        """Whether an error ended the thread; one that is through with its work has ended in order."""
        ended = self._thread is not None and not self._thread.is_alive()
        return ended and self._error is not None and not self.ended.is_set()

    def _work(self) -> None:
        self._error = None
        try:
            self.run()
        finally:
            self._error = sys.exception()
            self._cause = self._error or self._cause
