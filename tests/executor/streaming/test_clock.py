"""The clock counts by the controller's time; lost ticks are counted, never replayed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, repeat

import pytest

from executor.streaming.clock import EXCUSED_S, OWN_GAP_S, STALE_S, ControllerClock, LostTicks
from executor.streaming.rtde_connection import WATCHDOG_HZ, WATCHDOG_ORDINARY_HZ
from executor.streaming.state_checks import StreamFault

DT = 0.002


class Stamps:
    """A connection that returns these timestamps one after the other, then the last one for ever."""

    def __init__(self, *stamps: float) -> None:
        self._stamps: Iterator[float] = chain(stamps, repeat(stamps[-1]))

    def timestamp(self) -> float:
        return next(self._stamps)


def test_every_new_timestamp_is_a_tick() -> None:
    clock = ControllerClock(Stamps(10.0, 10.0, 10.002, 10.002, 10.004), DT)
    clock.wait()
    assert (clock.tick, clock.missed) == (1, 0)
    clock.wait()
    assert (clock.tick, clock.missed, clock.total_missed) == (2, 0, 0)


def test_lost_ticks_are_counted_and_skipped() -> None:
    clock = ControllerClock(Stamps(10.0, 10.002, 10.010, 10.012), DT)
    for _ in range(3):
        clock.wait()
    assert (clock.tick, clock.missed, clock.total_missed) == (6, 0, 3)


def test_a_state_that_stays_the_same_is_a_lost_link() -> None:
    clock = ControllerClock(Stamps(10.0), DT)
    with pytest.raises(StreamFault, match="no new state"):
        clock.wait()


class Time:
    """A clock on which each sleep takes as long as it is told to, then as the last one."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *sleeps_s: float) -> None:
        self.now_s = 50.0
        self._sleeps: Iterator[float] = chain(sleeps_s, repeat(sleeps_s[-1]))
        monkeypatch.setattr("executor.streaming.clock.monotonic", lambda: self.now_s)
        monkeypatch.setattr("executor.streaming.clock.sleep", self.sleep)

    def sleep(self, _: float) -> None:
        self.now_s += next(self._sleeps)
        assert self.now_s < 60.0


@pytest.mark.parametrize("late_s", [OWN_GAP_S + 1e-3, 0.03, 0.09])
def test_a_process_that_is_suspended_in_every_reading_notices_a_silent_link(
    monkeypatch: pytest.MonkeyPatch, late_s: float
) -> None:
    time = Time(monkeypatch, late_s)
    clock = ControllerClock(Stamps(10.0), DT)
    with pytest.raises(StreamFault, match="no new state"):
        clock.wait()
    assert EXCUSED_S < time.now_s - clock.host_s < EXCUSED_S + STALE_S + 2.0 * late_s


def test_a_suspension_is_no_silence_of_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """After one, long or repeated, a state may take as long as ever: the thread that receives it was suspended, too."""
    for sleeps_s in ((1e-3, 1.0, 0.0, 9e-3), (1e-3, 0.03, 0.03, 0.0, 9e-3)):
        Time(monkeypatch, *sleeps_s)
        clock = ControllerClock(Stamps(*[10.0] * (len(sleeps_s) + 2), 10.5), DT)
        clock.wait()
        assert clock.tick == 250


def test_time_that_runs_backwards_is_a_lost_link() -> None:
    clock = ControllerClock(Stamps(10.0, 10.002, 0.5), DT)
    clock.wait()
    with pytest.raises(StreamFault, match="backwards"):
        clock.wait()


def too_late(realtime: bool, missed: int, dt: float = DT) -> bool:
    """Whether so many ticks lost at once end a run, all of them lost because this thread had no processor."""
    return LostTicks(dt, realtime).are_too_many(missed, delayed_s=missed * dt)


def test_sixteen_milliseconds_in_a_row_are_too_late() -> None:
    assert not too_late(True, 7)
    assert too_late(True, 8)
    assert not too_late(True, 1, dt=0.008)
    assert too_late(True, 2, dt=0.008)


@pytest.mark.parametrize("dt", [0.002, 0.008])
@pytest.mark.parametrize(("realtime", "watchdog_hz"), [(True, WATCHDOG_HZ), (False, WATCHDOG_ORDINARY_HZ)])
def test_the_loop_brakes_no_later_than_the_controllers_watchdog(dt: float, realtime: bool, watchdog_hz: float) -> None:
    longest_s = LostTicks(dt, realtime).in_a_row * dt  # from one command to the next, one tick before the loop gives up
    assert longest_s <= 1.0 / watchdog_hz


def test_without_real_time_a_gap_is_borne_twice_as_long() -> None:
    assert not too_late(False, 19)
    assert too_late(False, 20)


def lost_until_late(realtime: bool, every: int, delayed_s: float, dt: float = DT) -> int | None:
    """Returns how many ticks pass until a run ends in which one is lost before every so many that arrive."""
    lost = LostTicks(dt, realtime)
    ticks = 0
    for i in range(1, 2000):
        missed = int(i % every == 0)
        ticks += 1 + missed
        if lost.are_too_many(missed, missed * delayed_s):
            return ticks
    return None


@pytest.mark.parametrize("delayed_s", [0.0, DT])
def test_one_tick_in_ten_is_too_late_but_one_in_a_hundred_is_not(delayed_s: float) -> None:
    rare = LostTicks(DT, True)
    often = LostTicks(DT, True)
    assert not any(rare.are_too_many(int(i % 100 == 0), delayed_s) for i in range(2000))
    assert any(often.are_too_many(int(i % 5 == 0), delayed_s) for i in range(2000))


def test_ticks_lost_by_the_link_are_judged_alike_with_and_without_real_time() -> None:
    assert lost_until_late(True, 1, 0.0) == lost_until_late(False, 1, 0.0) is not None
    assert lost_until_late(False, 1, 0.0) * DT < 0.025


def test_a_bad_link_is_noticed_as_early_on_a_slow_arm() -> None:
    assert lost_until_late(True, 1, 0.0, dt=0.008) * 0.008 <= 0.035


def test_a_thread_that_waits_a_little_in_every_tick_hides_no_bad_link() -> None:
    """A simulated controller on the same processor takes a third of every tick."""
    lost = LostTicks(DT, realtime=True)
    ticks = next(i for i in range(1, 1000) if lost.are_too_many(i % 2, 0.35 * DT))
    assert ticks < 25
    assert lost.cause == "the link lost them"


def test_ticks_lost_for_want_of_a_processor_are_borne_without_real_time() -> None:
    assert lost_until_late(True, 4, DT) is not None
    assert lost_until_late(False, 4, DT) is None


@pytest.mark.parametrize(("delayed_s", "cause"), [(0.0, "the link lost them"), (20 * DT, "this machine was busy")])
def test_who_lost_the_ticks_is_named(delayed_s: float, cause: str) -> None:
    lost = LostTicks(DT, realtime=True)
    assert lost.are_too_many(20, delayed_s)
    assert lost.cause == cause


def test_the_link_is_named_where_its_own_bound_ends_the_run() -> None:
    lost = LostTicks(DT, realtime=False)
    assert not lost.are_too_many(15, 15 * DT)
    assert lost.are_too_many(6, 0.0)
    assert lost.cause == "the link lost them"


def test_ticks_count_from_the_timestamp_nearest_to_one_that_is_due():
    clock = ControllerClock(Stamps(10.0, 10.002, 10.006), DT, first_s=10.0025)
    assert (clock.tick, clock.first) == (-1, pytest.approx(10.002))
    clock.wait()
    assert (clock.tick, clock.missed) == (0, 0)
    clock.wait()
    assert (clock.tick, clock.missed) == (2, 1)
