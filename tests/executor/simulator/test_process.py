"""The simulator as a process, and its counts."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from executor.simulator.statistics import Commands, Lateness

from .conftest import ROOT, Start, cell_text

COMMAND = [sys.executable, "-m", "executor.simulator", "--cell"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(start_simulator: Start, number: int):
    simulator = start_simulator()
    simulator.process.send_signal(number)
    assert simulator.process.wait(5.0) == 0


def test_quit_ends_it_cleanly(start_simulator: Start):
    simulator = start_simulator()
    simulator.ask("quit")
    assert simulator.process.wait(5.0) == 0


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
    for arrivals, answerable in ((1, True), (1, True), (0, False), (0, True), (3, True), (0, True), (1, False)):
        commands.answerable = answerable
        for _ in range(arrivals):
            commands.arrived(9)
        commands.cycle()
    commands.answerable = True
    commands.arrived(0)  # a kick of the watchdog is no command
    commands.cycle()
    commands.arrived(15)
    commands.cycle()
    expected = {"none": 4, "one": 3, "more": 1, "unanswerable": 1, "longest_gap_cycles": 2}
    assert commands.as_document() == expected


def test_quantiles_of_lateness():
    lateness = Lateness()
    for k in range(1000):
        lateness.add(k * 1e-6)
    assert lateness.quantile(0.5) == pytest.approx(500e-6, abs=4e-6)
    assert lateness.quantile(0.99) == pytest.approx(990e-6, abs=4e-6)
    assert lateness.as_document()["max_s"] == pytest.approx(999e-6)
