"""Processes that end with the one that started them."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing import parent_process

PARENT_POLL_S = 0.5  # [s] within which a process ends after one that did not start it by multiprocessing


def end_with_parent() -> None:
    """Makes this child of multiprocessing end with its parent, and not before.

    Signals to their whole group are the parent's: it lets this one finish its plan.
    """
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        _end_after(lambda: parent.join(), status=0)


def end_with_starter() -> None:
    """Makes this process end with whichever process has started it; it has not the time to tidy up then."""
    starter = os.getppid()

    def wait() -> None:
        while os.getppid() == starter:
            time.sleep(PARENT_POLL_S)

    _end_after(wait, status=1)


def _end_after(wait: Callable[[], None], status: int) -> None:
    def watch() -> None:
        wait()
        os._exit(status)

    threading.Thread(target=watch, daemon=True).start()
