"""What a thread did with its time."""

from __future__ import annotations

import time

from executor.streaming import realtime


def test_a_sleep_is_counted() -> None:
    before = realtime.sleeps()
    time.sleep(0.001)
    assert realtime.sleeps() > before
