"""Threads of the service by what they are for, so that a stop waits behind nothing that takes long.

All threads of a process share one interpreter, and the event loop is one of them. So what keeps it busy for long is
done one at a time, and every thread gives way after a millisecond.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

from anyio import CapacityLimiter, to_thread

COMMON = 16  # threads for everything that has no lane: most of them wait for the database
LARGE = 1  # for what takes long and is no hurry: reading large bodies, checking batches
RECORDS = 1  # for the audit trail of what was refused
STOPS = 4  # for stops alone
NOTES = 8  # for the stops in the database: one that does not answer holds each for as long
SWITCH_S = 0.001  # [s] after which a busy thread gives way to a waiting one


@dataclass(frozen=True)
class Lanes:
    """Limiters of the service's threads.

    Attributes:
        large: for bodies and batches that take long to read, one after another.
        records: for the audit trail of what was refused, when it is answered already.
        stops: for requests to brake.
        notes: for what the database is to know of them.
    """

    large: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(LARGE))
    records: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(RECORDS))
    stops: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(STOPS))
    notes: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(NOTES))


def share_interpreter() -> None:
    """Makes the threads of this process, and of the running event loop, share the interpreter fairly."""
    sys.setswitchinterval(SWITCH_S)
    to_thread.current_default_thread_limiter().total_tokens = COMMON
