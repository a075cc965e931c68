from __future__ import annotations

import pytest

from executor.streaming.command_watch import KNOWN_AFTER, CommandWatch

DT = 0.002


def watch_after(ticks: int, heard: int, late: int = 2) -> CommandWatch:
    """Returns a watch after `ticks` ticks of a launch at 10 rad/s^2, of which the controller heard the first ones.

    The target shows a command `late` ticks later.
    """
    watch = CommandWatch()
    for k in range(ticks):
        watch.look([10.0 * DT * max(0, min(k - late, heard))] * 6, k * DT)
        watch.sent([10.0 * DT * k] * 6)
    return watch


@pytest.mark.parametrize("late", [1, 2, 3])
def test_commands_that_arrive_are_not_lost(late: int):
    assert watch_after(100, 100, late).lost_s(99 * DT) == 0.0


def test_the_time_since_the_last_command_that_arrived():
    watch = watch_after(100, heard=60)
    assert watch.lost_s(99 * DT) == pytest.approx((99 - 60 - 3) * DT, abs=2 * DT)


def test_a_controller_that_publishes_something_else_says_nothing():
    watch = CommandWatch()
    for k in range(100):
        watch.look([9.0] * 6, k * DT)
        watch.sent([10.0 * DT * k] * 6)
    assert watch.lost_s(1.0) == 0.0
    assert watch_after(KNOWN_AFTER, heard=5).lost_s(1.0) == 0.0
