"""The clock counts by the controller's time; lost ticks are counted, never replayed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, repeat

import pytest

from executor.streaming.clock import Clock, Lateness
from executor.streaming.fault import LinkFault

DT = 0.002


class Stamps:
    """A link that shows these timestamps one after the other, then the last one for ever."""

    def __init__(self, *stamps: float) -> None:
        self._stamps: Iterator[float] = chain(stamps, repeat(stamps[-1]))

    def timestamp(self) -> float:
        return next(self._stamps)


def test_every_new_timestamp_is_a_tick() -> None:
    clock = Clock(Stamps(10.0, 10.0, 10.002, 10.002, 10.004), DT)
    clock.wait()
    assert (clock.tick, clock.missed) == (1, 0)
    clock.wait()
    assert (clock.tick, clock.missed, clock.total_missed) == (2, 0, 0)


def test_lost_ticks_are_counted_and_skipped() -> None:
    clock = Clock(Stamps(10.0, 10.002, 10.010, 10.012), DT)
    for _ in range(3):
        clock.wait()
    assert (clock.tick, clock.missed, clock.total_missed) == (6, 0, 3)


def test_a_state_that_stays_the_same_is_a_lost_link() -> None:
    clock = Clock(Stamps(10.0), DT)
    with pytest.raises(LinkFault, match="no new state"):
        clock.wait()


def test_time_that_runs_backwards_is_a_lost_link() -> None:
    clock = Clock(Stamps(10.0, 10.002, 0.5), DT)
    clock.wait()
    with pytest.raises(LinkFault, match="backwards"):
        clock.wait()


def test_twenty_milliseconds_in_a_row_are_too_late() -> None:
    assert not Lateness(DT, True).too_late(9)
    assert Lateness(DT, True).too_late(10)
    assert Lateness(0.008, True).too_late(3)


def test_without_real_time_a_gap_is_borne_twice_as_long() -> None:
    assert not Lateness(DT, False).too_late(19)
    assert Lateness(DT, False).too_late(20)


def test_one_tick_in_ten_is_too_late_but_one_in_a_hundred_is_not() -> None:
    rare, often = Lateness(DT, True), Lateness(DT, True)
    assert not any(rare.too_late(int(i % 100 == 0)) for i in range(2000))
    assert any(often.too_late(int(i % 5 == 0)) for i in range(2000))
