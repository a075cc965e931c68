"""Real-time scheduling of the simulator, where it is permitted; what was granted is told in words."""

from __future__ import annotations

import os
from collections.abc import Mapping

CORE_VARIABLE = "FLING_STREAM_CORE"  # the executor's: controller and stream are meant to share a processor


def default_core(environment: Mapping[str, str]) -> int:
    """Returns the processor of the stream: the highest this process may use, where nothing else is said."""
    return int(environment.get(CORE_VARIABLE) or max(os.sched_getaffinity(0)))


def is_real_time() -> bool:
    """Whether this process was granted real-time priority."""
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def take_priority(priority: int, core: int) -> str:
    """Asks for real-time `priority` on processor `core` (-1: any); returns in words what was granted.

    Without the priority every processor is as good: then it may run on whichever is free.
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
