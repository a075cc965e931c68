"""Waiting for what a test expects, with an end: without one a fault would hang the whole run."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

WITHIN_S = 60.0  # [s] long enough for a busy machine
PERIOD_S = 0.01


def until(condition: Callable[[], object], within_s: float = WITHIN_S, period_s: float = PERIOD_S) -> None:
    """Waits for a condition, up to `within_s` [s]."""
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(period_s)


async def until_true(condition: Callable[[], object], within_s: float = WITHIN_S, period_s: float = PERIOD_S) -> None:
    """Waits for a condition in an event loop, up to `within_s` [s]."""
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        await asyncio.sleep(period_s)
