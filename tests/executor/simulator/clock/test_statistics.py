"""Counts of commands per cycle, and quantiles of lateness."""

import pytest

from executor.simulator.clock.statistics import LatenessHistogram, StreamCounts


def test_fresh_commands_are_counted_cycle_by_cycle_while_a_client_streams():
    commands = StreamCounts()
    commands.cycle()
    for arrivals in (1, 1, 0, 0, 3, 0, 1):
        for _ in range(arrivals):
            commands.command_arrived(9)
        commands.cycle()
    commands.command_arrived(0)  # a kick of the watchdog is no command
    commands.cycle()
    commands.command_arrived(15)
    commands.cycle()
    assert commands.as_document() == {"none": 4, "one": 3, "more": 1, "longest_gap_cycles": 2}


def test_quantiles_of_lateness():
    lateness = LatenessHistogram()
    for k in range(1000):
        lateness.add(k * 1e-6)
    assert lateness.quantile(0.5) == pytest.approx(500e-6, abs=4e-6)
    assert lateness.quantile(0.99) == pytest.approx(990e-6, abs=4e-6)
    assert lateness.as_document()["max_s"] == pytest.approx(999e-6)
