"""The daemon's own punctuality while it supervises: real-time scheduling below the stream's, where permitted.

All its threads together: one that holds the interpreter and does not get a processor would keep the others waiting.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

DAEMON_PRIORITY = 10  # of SCHED_FIFO; above everything ordinary, below the stream and the library's threads
SILENT_S = 0.100  # [s] the pulse comes every 5 ms; this long without one the daemon is frozen or dead
SILENT_ORDINARY_S = 0.250  # [s] with ordinary scheduling a busy machine makes gaps of 100 ms (rtde.md, section 11)


def silence_limit() -> float:
    """Returns how long the daemon may be silent before the stream takes it for gone [s]."""
    return SILENT_S if _is_permitted() else SILENT_ORDINARY_S


@contextmanager
def punctual() -> Iterator[None]:
    """Gives every thread of this process real-time priority for a while; nothing where that is not permitted."""
    permitted = _is_permitted()
    if permitted:
        _schedule(os.SCHED_FIFO, DAEMON_PRIORITY)
    try:
        yield
    finally:
        if permitted:
            _schedule(os.SCHED_OTHER, 0)


def _schedule(policy: int, priority: int) -> None:
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # it has just ended
            os.sched_setscheduler(int(thread), policy, os.sched_param(priority))


def _is_permitted() -> bool:
    """Whether this process may take real-time priority: tries it on this thread for a moment."""
    before = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(DAEMON_PRIORITY))
    except PermissionError:
        return False
    if before != os.SCHED_FIFO:
        os.sched_setscheduler(0, before, os.sched_param(0))
    return True
