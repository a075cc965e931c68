"""The dashboard over a program that only counts: no controller, no arm."""

from __future__ import annotations

import pytest

from executor.simulator.interfaces import DashboardServer
from executor.simulator.program import PAUSED
from executor.simulator.settings import ControllerIdentity, SimulatorSettings

from ..conftest import Connect, ProgramParts

IDENTITY = ControllerIdentity((5, 22, 0), 9, "42", "UR10")


@pytest.fixture
def parts() -> ProgramParts:
    return ProgramParts(SimulatorSettings(protective_stop_lock_s=1.0))


@pytest.fixture
def dashboard(parts: ProgramParts) -> DashboardServer:
    return DashboardServer(IDENTITY, parts.stops)


def test_the_identity_is_answered(dashboard: DashboardServer):
    assert dashboard.answer("PolyscopeVersion") == "URSoftware 5.22.0.9 (Jan 01 2024)"
    assert dashboard.answer("get serial number") == "42"
    assert dashboard.answer("get robot model") == "UR10"


def test_play_pause_and_stop_act_on_the_program(parts: ProgramParts, dashboard: DashboardServer):
    parts.play()
    assert dashboard.answer("programState") == "PLAYING counting"
    assert dashboard.answer("pause") == "Pausing program"
    assert parts.runner.runtime == PAUSED
    parts.at_rest = False
    assert dashboard.answer("play") == "Failed to execute: play"
    parts.at_rest = True
    assert dashboard.answer("play") == "Starting program"
    assert dashboard.answer("running") == "Program running: true"
    assert dashboard.answer("stop") == "Stopped"
    assert dashboard.answer("programState") == "STOPPED No program"


def test_a_protective_stop_is_unlocked_after_its_time(parts: ProgramParts, dashboard: DashboardServer):
    parts.stops.protective("test")
    assert dashboard.answer("safetymode") == "Safetymode: PROTECTIVE_STOP"
    parts.cycle(499)
    assert dashboard.answer("unlock protective stop").startswith("Cannot unlock")
    parts.cycle(1)
    assert dashboard.answer("unlock protective stop") == "Protective stop releasing"
    assert dashboard.answer("safetymode") == "Safetymode: NORMAL"


def test_power_comes_back_step_by_step(parts: ProgramParts, dashboard: DashboardServer):
    for command, mode in (("power off", "POWER_OFF"), ("power on", "IDLE"), ("brake release", "RUNNING")):
        dashboard.answer(command)
        assert dashboard.answer("robotmode") == f"Robotmode: {mode}"


def test_local_control_refuses_commands_but_answers_questions(parts: ProgramParts, dashboard: DashboardServer):
    parts.runner.remote_control = False
    for command in ("play", "stop", "power off", "load x.urp", "shutdown"):
        assert "not in remote control" in dashboard.answer(command)
    assert dashboard.answer("robotmode") == "Robotmode: RUNNING"


def test_a_client_is_greeted_answered_line_by_line_and_left_after_quit(dashboard: DashboardServer, connect: Connect):
    line = connect(dashboard)
    assert line.received() == b"Connected: Universal Robots Dashboard Server\n"
    assert line.send(b"robot") == b""
    assert line.send(b"mode\nquit\nrobotmode\n") == b"Robotmode: RUNNING\nDisconnected\n"
    assert not line.connection.open
