"""The simulator as a process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from executor import realtime
from simulator.scheduling import default_core
from tests.simulator.conftest import ROOT, Start, cell_text

COMMAND = [sys.executable, "-m", "simulator", "--cell"]
STOPS = 5
STOPPED_S = 0.03
LONG_STOP_S = 0.2  # several times READ_WITHIN_S
CATCHES_UP_S = 5.0  # [s] after that, on a busy machine
READ_WITHIN_S = 0.05  # [s] between reading the counts and reading the clock


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(start_simulator: Start, number: int):
    simulator = start_simulator()
    simulator.process.send_signal(number)
    assert simulator.process.wait(5.0) == 0


def test_quit_ends_it_cleanly(start_simulator: Start):
    simulator = start_simulator()
    simulator.ask("quit")
    assert simulator.process.wait(5.0) == 0


def test_a_bin_is_placed_and_removed_on_request(start_simulator: Start):
    simulator = start_simulator()
    simulator.ask("place_bin", bottom_m=[1.0, 0.2, 0.0], radius_m=0.1, rim_height_m=0.2)
    simulator.ask("remove_bin")
    for numbers in ({"radius_m": 0.1}, {"bottom_m": [1.0, 0.2], "radius_m": 0.1, "rim_height_m": 0.2},
                    {"bottom_m": [1.0, 0.2, 0.0], "radius_m": 0.0, "rim_height_m": 0.2}):  # fmt: skip
        with pytest.raises(AssertionError, match="a bin"):
            simulator.ask("place_bin", **numbers)


def test_a_stopped_process_loses_controller_time_and_no_cycle(start_simulator: Start):
    """Wall-clock time is controller time plus slips; nothing is caught up."""
    simulator = start_simulator()
    simulator.ask("reset_stats")
    before = simulator.ask("stats")
    began = time.monotonic()
    for _ in range(STOPS):
        simulator.process.send_signal(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        simulator.process.send_signal(signal.SIGCONT)
        time.sleep(STOPPED_S)
    after = simulator.ask("stats")
    passed = time.monotonic() - began
    slips = after["slips"]
    assert slips["count"] >= STOPS
    assert slips["max_s"] > 0.9 * STOPPED_S
    assert after["t"] - before["t"] + slips["total_s"] == pytest.approx(passed, abs=READ_WITHIN_S)
    assert after["t"] - before["t"] < passed - 0.9 * STOPS * STOPPED_S


def test_a_strict_clock_catches_up_after_a_stop(start_simulator: Start):
    simulator = start_simulator(options=("--strict-clock",))
    before = simulator.ask("stats")
    began = time.monotonic()
    simulator.process.send_signal(signal.SIGSTOP)
    time.sleep(LONG_STOP_S)
    simulator.process.send_signal(signal.SIGCONT)
    until = time.monotonic() + CATCHES_UP_S
    while True:
        after = simulator.ask("stats")
        late_s = time.monotonic() - began - (after["t"] - before["t"])
        if late_s < READ_WITHIN_S or time.monotonic() > until:
            break
    assert after["slips"]["count"] == 0
    assert abs(late_s) < READ_WITHIN_S


@pytest.mark.skipif(not realtime.is_permitted(), reason="real-time priority needs permission")
def test_priority_and_processor_are_taken_as_requested(start_simulator: Start):
    core = min(os.sched_getaffinity(0))
    simulator = start_simulator(options=("--priority", "1", "--core", str(core)))
    assert os.sched_getscheduler(simulator.process.pid) == os.SCHED_FIFO
    assert os.sched_getaffinity(simulator.process.pid) == {core}
    ordinary = start_simulator(options=("--core", str(core)))
    assert os.sched_getaffinity(ordinary.process.pid) == os.sched_getaffinity(0)


def test_the_processor_is_the_streams():
    """Neither room imports the other, so the variable and its default are compared here."""
    for environment in ({"FLING_STREAM_CORE": "-1"}, {"FLING_STREAM_CORE": ""}, {}):
        assert default_core(environment) == realtime.default_core(environment)
    assert default_core({"FLING_STREAM_CORE": "-1"}) == -1
    assert default_core({}) == max(os.sched_getaffinity(0))


@pytest.mark.slow
def test_a_bad_cell_and_a_taken_address_are_reported(start_simulator: Start, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('robot = "ur99"\n')
    done = subprocess.run([*COMMAND, str(path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ur99" in done.stderr
    path.write_text(cell_text(host=start_simulator().host))
    done = subprocess.run([*COMMAND, str(path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "in use" in done.stderr
