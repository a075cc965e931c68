"""Counts of commands per cycle."""

from simulator.clock.timeline import StreamCounts


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
    assert commands.counts == {"none": 4, "one": 3, "more": 1, "longest_gap_cycles": 2}
