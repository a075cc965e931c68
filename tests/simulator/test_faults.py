"""Each fault as the real ur_rtde client sees it, and the arm's decelerations.

Each scenario runs the client in its own process, because it may hang or crash; several run at once.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from simulator.settings import Decelerations, SimulatorSettings
from tests.simulator.conftest import ROOT, Driven, Simulator, Start, make_cell
from tests.simulator.fault_client import SCENARIOS

CLIENT = Path(__file__).with_name("fault_client.py")
AT_ONCE = 6  # scenarios that run at the same time: they mostly sleep
HANGS_S = 40.0  # [s] after it a client counts as hanging; several times the longest scenario on a loaded machine
EXPECTED_TO_HANG_S = {"mute_rtde": 4.0, "control_closed": 8.0}
PROTECTIVE = 3
SAFEGUARD = 5
EMERGENCY = 7
POWER_OFF = 3
STOPPED = 1
PLAYING = 2
PAUSED = 4
Outcomes = dict[str, dict[str, Any]]


def observed(simulator: Simulator, scenario: str) -> dict[str, Any]:
    """Runs a scenario; returns what the client printed, {"hangs": true} or {"crashed": signal}."""
    command = [sys.executable, str(CLIENT), simulator.host, scenario]
    timeout = EXPECTED_TO_HANG_S.get(scenario, HANGS_S)
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return {"hangs": True}
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode > 0:
        return {"failed": done.stderr[-1000:]}
    return json.loads(lines[-1]) if done.returncode == 0 else {"crashed": -done.returncode}


@pytest.fixture(scope="module")
def outcomes(start_simulator: Start) -> Outcomes:
    """Observations of the client in every scenario, with the events of its simulator."""

    def run(name: str) -> dict[str, Any]:
        simulator = start_simulator(options=("--protective-stop-lock-s", "0.2"))
        seen = observed(simulator, name)
        if name != "killed":
            seen["events"] = [text for _, text in simulator.ask("events")["events"]]
        simulator.close()
        return seen

    longest_first = sorted(SCENARIOS, key=lambda name: -EXPECTED_TO_HANG_S.get(name, 0.0))
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(longest_first, pool.map(run, longest_first), strict=True))


def seen_in(outcomes: Outcomes, scenario: str) -> dict[str, Any]:
    """Returns the observations of the client, without the simulator's events."""
    return {key: value for key, value in outcomes[scenario].items() if key != "events"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "runtime", "mode", "bit"),
    [
        ("protective_stop_paused", PAUSED, PROTECTIVE, 2),
        ("protective_stop_stopped", STOPPED, PROTECTIVE, 2),
        ("safeguard_stop", PAUSED, SAFEGUARD, 4),
        ("emergency_stop", STOPPED, EMERGENCY, 7),
        ("stop_program", STOPPED, 1, 0),
        ("pause_program", PAUSED, 1, 0),
        ("power_loss", STOPPED, 1, 0),
    ],
)
def test_a_stop_makes_every_command_false(outcomes: Outcomes, scenario: str, runtime: int, mode: int, bit: int):
    seen = outcomes[scenario]
    assert seen["answers"] == ["False"]
    assert seen["moveJ"] is False
    assert seen["runtime"] == runtime
    assert seen["safety_mode"] == mode
    assert seen["safety_bits"] & 1 << bit
    assert seen["protective"] == (mode == PROTECTIVE)
    assert seen["emergency"] == (mode == EMERGENCY)


def test_power_is_off_after_emergency_stop_and_power_loss(outcomes: Outcomes):
    assert outcomes["emergency_stop"]["robot_mode"] == POWER_OFF
    assert outcomes["power_loss"]["robot_mode"] == POWER_OFF


def test_a_protective_stop_that_leaves_the_program_playing_hides_from_speedj(outcomes: Outcomes):
    assert outcomes["protective_stop_playing"]["answers"] == ["True"]
    assert outcomes["protective_stop_playing"]["protective"] is True


def test_play_after_unlocking_resumes_the_old_speed_and_an_upload_does_not(outcomes: Outcomes):
    assert seen_in(outcomes, "unlock_and_play") == {"resumed": pytest.approx(0.2), "after_upload": 0.0, "runs": True}


def test_a_killed_controller_goes_on_answering_true(outcomes: Outcomes):
    seen = outcomes["killed"]
    assert seen["last"] is True
    assert set(seen["errors"]) <= {"Timeout connecting to UR dashboard server."}
    assert seen["connected"] is False
    assert seen["running"] is True


def test_a_controller_frozen_for_less_than_a_second_is_not_noticed(outcomes: Outcomes):
    assert seen_in(outcomes, "frozen") == {"answers": ["True"], "connected": True}


def test_a_stalled_receive_stream_is_stale_for_seconds_before_it_counts_as_lost(outcomes: Outcomes):
    assert seen_in(outcomes, "receive_stalled") == {"advanced": 0.0, "early": True, "middle": True, "late": False}


def test_a_closed_receive_connection_keeps_stale_values_until_it_reconnects(outcomes: Outcomes):
    assert seen_in(outcomes, "receive_closed") == {"connected": False, "stale": 6, "again": True}


def test_a_closed_io_connection_loses_the_first_call_silently(outcomes: Outcomes):
    seen = outcomes["io_closed"]
    assert seen["answers"][0] is True
    assert "Broken pipe" in seen["answers"][2]
    assert seen["again"] is True
    assert seen["bit"] is True


def test_a_closed_control_connection_uploads_again_or_ends_the_client(outcomes: Outcomes):
    seen = outcomes["control_closed"]
    uploads = sum("script received" in text for text in seen["events"])
    assert uploads > 1 or "crashed" in seen or "hangs" in seen
    assert uploads >= 1


def test_two_control_clients_connect_but_only_one_program_runs(outcomes: Outcomes):
    expected = {"alone": True, "arrived": True, "second": True, "first_still": True, "speed": 0.0}
    assert seen_in(outcomes, "second_client") == expected


def test_delayed_and_dropped_packages_arrive_late_and_not_at_all(outcomes: Outcomes):
    assert outcomes["delayed"]["late"] > 0.15
    assert outcomes["delayed"]["seen"] < 0.8


def test_dropped_commands_are_cycles_without_one(outcomes: Outcomes):
    counted = outcomes["dropped_commands"]
    assert counted["none"] > 0.2 * (counted["none"] + counted["one"] + counted["more"])


def test_the_speed_slider_scales_speedj(outcomes: Outcomes):
    assert seen_in(outcomes, "slider") == pytest.approx({"fraction": 0.5, "combined": 0.5, "speed": 0.1})


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ("local_mode", "enable remote control"),
        ("offline", "Could not connect"),
        ("mute_dashboard", "Operation canceled"),
        ("protective_stop_before", "Failed to start control script"),
    ],
)
def test_a_constructor_under_a_fault_raises(outcomes: Outcomes, scenario: str, message: str):
    assert message in outcomes[scenario]["error"]


def test_a_constructor_hangs_where_rtde_never_answers(outcomes: Outcomes):
    assert seen_in(outcomes, "mute_rtde") == {"hangs": True}


def test_back_online_after_a_time_offline(start_simulator: Start):
    simulator = start_simulator()
    simulator.fault("offline")
    simulator.fault("offline", on=False)
    assert observed(simulator, "stop_program")["answers"] == ["False"]


@pytest.mark.parametrize("port", ["primary", "script", "rtde", "dashboard"])
def test_a_client_of_a_mute_port_that_leaves_takes_nothing_with_it(start_simulator: Start, port: str):
    simulator = start_simulator()
    numbers = {"primary": 30001, "script": 30003, "rtde": 30004, "dashboard": 29999}
    simulator.fault("mute", port=port)
    with socket.create_connection((simulator.host, numbers[port])) as client:
        client.sendall(b"anything\n")
        simulator.fault("mute", port=port, on=False)
        client.sendall(b"anything\n")
    before = simulator.ask("state")["t"]
    time.sleep(0.1)
    assert simulator.ask("state")["t"] > before


def test_unknown_faults_and_parameters_are_refused(start_simulator: Start):
    simulator = start_simulator()
    refused = (
        {"name": "nonsense"},
        {"name": "freeze", "duration_s": -1},
        {"name": "freeze", "minutes": 1},
        {"name": "freeze", "duration_s": "abc"},
        {"name": "freeze", "duration_s": True},
        {"name": "local_mode", "on": 1},
        {"name": "mute", "port": "control"},
        {"name": "close_connection", "role": "all"},
        {"name": "speed_slider", "fraction": 2},
        {"name": "disturb_connection", "drop": 2},
        {},
    )
    for request in refused:
        with pytest.raises(AssertionError):
            simulator.ask("fault", **request)


@pytest.mark.parametrize(
    ("cause", "deceleration"),
    [
        (lambda c: c.stops.protective("test"), Decelerations.protective_stop),
        (lambda c: c.stops.safeguard(), Decelerations.safeguard_stop),
        (lambda c: c.stops.emergency(), Decelerations.emergency_stop),
        (lambda c: c.stops.power_loss(), Decelerations.power_loss),
        (lambda c: c.runner.stop("test"), Decelerations.program_end),
        (lambda c: c.runner.pause(), Decelerations.program_end),
    ],
)
def test_each_stop_brakes_at_its_documented_deceleration(cause, deceleration):
    driven = Driven(make_cell())
    driven.write(9, [2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 40.0, 0.002])
    driven.cycle(100)
    cause(driven.controller)
    driven.cycle(10)
    assert driven.arm.qd[0] == pytest.approx(2.0 - 10 * 0.002 * deceleration)
    assert driven.arm.qd[1] == pytest.approx(driven.arm.qd[0] / 2)
    driven.cycle(200)
    assert driven.arm.qd == [0.0] * 6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "acceleration", "reason"),
    [
        ([3.5, 0, 0, 0, 0, 0], 40.0, "joint speed"),
        ([1.0, 0, 0, 0, 0, 0], 60.0, "joint acceleration"),
        ([2.5, 0, 0, 0, 0, 0], 40.0, "tool speed"),
        ([0, 0, 0, 0, 0, 3.1], 40.0, "joint position"),
    ],
)
def test_a_violated_limit_is_a_protective_stop(speed, acceleration, reason):
    driven = Driven(make_cell(), SimulatorSettings(tcp_speed_limit_m_s=1.0 if reason == "tool speed" else 5.0))
    driven.write(9, [*speed, acceleration, 0.002])
    for _ in range(1500):
        driven.cycle()
        if driven.controller.safety.stopped:
            break
    assert reason in driven.controller.safety.reason
    driven.cycle(300)
    assert driven.arm.qd == [0.0] * 6
