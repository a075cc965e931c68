"""Real-time scheduling of the simulator process, where the system permits it."""

from __future__ import annotations

import os
from collections.abc import Mapping

CORE_VARIABLE = "FLING_STREAM_CORE"  # the executor's setting: controller and stream share a processor


def default_core(environment: Mapping[str, str]) -> int:
    """Returns the stream's processor: the one of the environment, by default the highest available one."""
    return int(environment.get(CORE_VARIABLE) or max(os.sched_getaffinity(0)))


def is_real_time() -> bool:
    """Whether this process runs at real-time priority."""
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
    except (OSError, AttributeError):
        return "ordinary priority (real-time priority is not permitted)"
    if core < 0:
        return f"real-time priority {priority}"
    try:
        os.sched_setaffinity(0, {core})
    except OSError:
        return f"real-time priority {priority} (processor {core} is not permitted)"
    return f"real-time priority {priority} on processor {core}"
