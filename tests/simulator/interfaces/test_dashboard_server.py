"""The dashboard over a program that only counts: no controller, no arm."""

from __future__ import annotations

from pathlib import Path

import pytest

from simulator.interfaces import DashboardServer
from simulator.program import PAUSED
from simulator.settings import ControllerIdentity, SimulatorSettings
from tests.simulator.conftest import SCRIPT, Connect, ProgramParts

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


def test_a_stored_program_is_loaded_and_played(parts: ProgramParts, tmp_path: Path):
    (tmp_path / "wait.script").write_text(SCRIPT)
    dashboard = DashboardServer(IDENTITY, parts.stops, tmp_path)
    assert dashboard.answer("get loaded program") == "No program loaded"
    assert dashboard.answer("play") == "Failed to execute: play"
    for missing in ("other.urp", "../wait.urp", "/etc/passwd", "\0"):
        assert dashboard.answer(f"load {missing}").startswith("File not found")
    for path in ("wait.urp", "/ursim/programs/wait.urp"):
        assert dashboard.answer(f"load {path}") == f"Loading program: {path}"
        assert dashboard.answer("get loaded program") == f"Loaded program: {path}"
    assert dashboard.answer("programState") == "STOPPED wait.urp"
    assert dashboard.answer("isProgramSaved") == "true wait.urp"
    assert dashboard.answer("play") == "Starting program"
    parts.cycle(30)
    assert dashboard.answer("programState") == "PLAYING wait.urp"
    dashboard.answer("pause")
    assert dashboard.answer("play") == "Starting program"  # goes on where it was
    assert (parts.runner.playing, parts.runner.due) == (True, None)


def test_operational_mode_installation_and_reports(dashboard: DashboardServer):
    assert dashboard.answer("get operational mode") == "NONE"
    assert dashboard.answer("set operational mode AUTOMATIC") == "Operational mode 'AUTOMATIC' is set"
    assert dashboard.answer("get operational mode") == "AUTOMATIC"
    assert dashboard.answer("set operational mode x").startswith("Failed")
    assert dashboard.answer("clear operational mode").startswith("No longer controlling the operational mode.")
    assert dashboard.answer("get operational mode") == "NONE"
    assert dashboard.answer("load installation default.installation") == "Loading installation: default.installation"
    assert dashboard.answer("load installation x").startswith("File not found")
    assert dashboard.answer("generate flight report controller") == "Flight Report generated with id: 1"
    assert dashboard.answer("generate support file .") == "Completed successfully: ./support_2.zip"
    assert dashboard.answer("saveLog") == "Log saved to disk"


def test_each_generation_has_its_own_commands(parts: ProgramParts, dashboard: DashboardServer):
    cb3 = DashboardServer(ControllerIdentity((3, 15, 0), 9, "42", "UR10"), parts.stops)
    for command in ("safetystatus", "is in remote control", "set operational mode MANUAL"):
        assert cb3.answer(command).startswith("could not understand")
    assert cb3.answer("setUserRole PROGRAMMER") == "Setting user role: PROGRAMMER"
    assert cb3.answer("getUserRole") == "PROGRAMMER"
    assert dashboard.answer("getUserRole").startswith("could not understand")


def test_without_remote_control_in_the_settings_nothing_is_refused():
    parts = ProgramParts(SimulatorSettings(remote_control_enabled=False))
    dashboard = DashboardServer(IDENTITY, parts.stops)
    assert dashboard.answer("is in remote control") == "false"
    assert dashboard.answer("power off") == "Powering off"


def test_a_brake_release_powers_the_arm_too(dashboard: DashboardServer):
    dashboard.answer("power off")
    dashboard.answer("brake release")
    assert dashboard.answer("robotmode") == "Robotmode: RUNNING"


def test_a_client_is_greeted_answered_line_by_line_and_left_after_quit(dashboard: DashboardServer, connect: Connect):
    line = connect(dashboard)
    assert line.received() == b"Connected: Universal Robots Dashboard Server\n"
    assert line.send(b"robot") == b""
    assert line.send(b"mode\nquit\nrobotmode\n") == b"Robotmode: RUNNING\nDisconnected\n"
    assert not line.connection.open
