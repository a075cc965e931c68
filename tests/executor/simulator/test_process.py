"""The simulator as a process, and its counts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from executor import realtime
from executor.simulator.realtime import default_core
from executor.simulator.statistics import Commands, Lateness

from .conftest import ROOT, Start, cell_text

COMMAND = [sys.executable, "-m", "executor.simulator", "--cell"]
STOPS, STOPPED_S = 5, 0.03
ASKED_WITHIN_S = 0.05  # [s] between a count and the look at the clock beside it


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(start_simulator: Start, number: int):
    simulator = start_simulator()
    simulator.process.send_signal(number)
    assert simulator.process.wait(5.0) == 0


def test_quit_ends_it_cleanly(start_simulator: Start):
    simulator = start_simulator()
    simulator.ask("quit")
    assert simulator.process.wait(5.0) == 0


def test_a_stopped_process_loses_controller_time_and_no_cycle(start_simulator: Start):
    """What passes on the clock is controller time and slips; nothing is caught up."""
    simulator = start_simulator()
    simulator.ask("reset_stats")
    before, began = simulator.ask("stats"), time.monotonic()
    for _ in range(STOPS):
        simulator.process.send_signal(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        simulator.process.send_signal(signal.SIGCONT)
        time.sleep(STOPPED_S)
    after, passed = simulator.ask("stats"), time.monotonic() - began
    slips = after["slips"]
    assert slips["count"] >= STOPS
    assert slips["max_s"] > 0.9 * STOPPED_S
    assert after["t"] - before["t"] + slips["total_s"] == pytest.approx(passed, abs=ASKED_WITHIN_S)
    assert after["t"] - before["t"] < passed - 0.9 * STOPS * STOPPED_S


@pytest.mark.skipif(os.geteuid() != 0, reason="real-time priority needs permission")
def test_priority_and_processor_are_taken_and_told(start_simulator: Start):
    core = min(os.sched_getaffinity(0))
    simulator = start_simulator(options=("--priority", "1", "--core", str(core)))
    assert os.sched_getscheduler(simulator.process.pid) == os.SCHED_FIFO
    assert os.sched_getaffinity(simulator.process.pid) == {core}
    ordinary = start_simulator(options=("--core", str(core)))
    assert os.sched_getaffinity(ordinary.process.pid) == os.sched_getaffinity(0)


def test_the_processor_is_the_streams():
    assert default_core({"FLING_STREAM_CORE": "-1"}) == -1
    assert default_core({}) == realtime.default_core({})


def test_a_bad_cell_and_a_taken_address_are_told(start_simulator: Start, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('robot = "ur99"\n')
    done = subprocess.run([*COMMAND, str(path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ur99" in done.stderr
    path.write_text(cell_text(host=start_simulator().host))
    done = subprocess.run([*COMMAND, str(path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "in use" in done.stderr


def test_fresh_commands_are_counted_cycle_by_cycle_while_a_client_streams():
    commands = Commands()
    commands.cycle()
    for arrivals in (1, 1, 0, 0, 3, 0, 1):
        for _ in range(arrivals):
            commands.arrived(9)
        commands.cycle()
    commands.arrived(0)  # a kick of the watchdog is no command
    commands.cycle()
    commands.arrived(15)
    commands.cycle()
    assert commands.as_document() == {"none": 4, "one": 3, "more": 1, "longest_gap_cycles": 2}


def test_quantiles_of_lateness():
    lateness = Lateness()
    for k in range(1000):
        lateness.add(k * 1e-6)
    assert lateness.quantile(0.5) == pytest.approx(500e-6, abs=4e-6)
    assert lateness.quantile(0.99) == pytest.approx(990e-6, abs=4e-6)
    assert lateness.as_document()["max_s"] == pytest.approx(999e-6)
