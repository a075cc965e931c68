"""Real-time priority of the simulator, and the processor that it stays on.

Nothing here is required to succeed: what the system does not permit is reported.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

REALTIME_PRIORITY = 60  # of SCHED_FIFO; above a client's, so that on one processor no client makes the controller late
CORE_VARIABLE = "FLING_STREAM_CORE"  # names the processor of the executor's stream; source: executor/settings.py


def default_core(environment: Mapping[str, str]) -> int:
    """Returns the processor of the executor's stream: the one set in the environment, or the highest available.

    Raises:
        ValueError: it is no number.
    """
    text = environment.get(CORE_VARIABLE) or str(max(os.sched_getaffinity(0)))
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{CORE_VARIABLE} {text!r} is not the number of a processor, or -1") from None


def is_real_time() -> bool:
    """Whether this thread runs at real-time priority."""
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def request_real_time(priority: int, core: int) -> str:
    """Requests a real-time priority, and binds the process to a processor if it is granted.

    At ordinary priority the process stays free to run on any processor.

    Args:
        priority: SCHED_FIFO priority; 0 or less keeps the ordinary one.
        core: processor number; -1 for any.

    Returns:
        A description of what was granted.
    """
    if priority <= 0:
        return "ordinary priority"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return "ordinary priority (real-time priority is not permitted)"
    if core < 0:
        return f"real-time priority {priority}"
    try:
        os.sched_setaffinity(0, {core})
    except OSError:
        return f"real-time priority {priority} (processor {core} is not permitted)"
    return f"real-time priority {priority} on processor {core}"
