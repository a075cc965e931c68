"""`fling cell new`: five answers make a cell that passes `cell check`, and in which a first throw is planned."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from api.cli import main
from api.cli.cell_new import Answers, cell_written, first_target
from planner.cell import load_cell
from planner.cell_folder import file_faults, home_faults
from planner.planning import plan
from planner.request import problem_from_request
from planner.robots import ROBOT_NAMES

TOLD = {
    "models": ["ur10e", "ur12e"],
    "polyscope": "5.12.3.118",
    "serial": "20245500815",
    "payload_kg": 1.25,
    "tcp_offset": [0.0, 0.01, 0.2, 0.0, 0.0, 0.5],
}
TWIN = "cells/lab-sim.toml"


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FLING_CELLS", raising=False)


def new(*arguments: str, answers: str = "") -> Result:
    return CliRunner().invoke(main, ["cell", "new", *arguments], input=answers)


def answering(monkeypatch: pytest.MonkeyPatch, told: dict[str, Any] | None) -> None:
    def asked(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        assert command[-2:] == ["--find", "192.0.2.7"]
        return subprocess.CompletedProcess(command, 0 if told else 1, json.dumps(told), "")

    monkeypatch.setattr(subprocess, "run", asked)


def test_five_answers_make_a_cell_that_passes_the_check() -> None:
    made = new("lab", answers="sim\nur3e\n0.2\n1.5\nstandard_digital 4\n")
    assert made.exit_code == 0, made.output
    for number in range(1, 6):
        assert f"{number} of 5: " in made.output
    assert "fling up --cell lab, and in another terminal: fling throw 0.7 0.3 0.0" in made.output
    assert file_faults("cells/lab.toml") == []
    cell = load_cell("cells/lab.toml")
    assert (cell.robot.name, cell.link.kind, cell.tool.mass_kg) == ("ur3e", "sim", 1.5)
    assert cell.tool.X_FT[:3, 3].tolist() == [0.0, 0.0, 0.2]
    assert (cell.gripper.output, cell.gripper.index) == ("standard_digital", 4)


@pytest.mark.parametrize(
    ("answer", "kind", "model"),
    [("2F85", "robotiq", "2f85"), ("vg10", "onrobot", "vg10"), ("vacuum standard_digital 3", "vacuum", None)],
)
def test_the_gripper_may_have_a_bus_or_be_a_vacuum(answer: str, kind: str, model: str | None) -> None:
    made = new("lab", "--polyscope", "x", answers=f"sim\nUR7e\n\n\n{answer}\n")
    assert made.exit_code == 0, made.output
    assert "or a model: 2f85, 2f140" in made.output
    assert "simulated with PolyScope 10.14.0" in made.output
    assert file_faults("cells/lab.toml") == []
    cell = load_cell("cells/lab.toml")
    assert (cell.gripper.kind, cell.sim.polyscope) == (kind, "10.14.0")
    assert (cell.gripper.link and cell.gripper.link.model) == model
    if kind == "vacuum":
        assert (cell.gripper.output, cell.gripper.index, cell.gripper.open_level) == ("standard_digital", 3, False)


def test_a_compute_box_is_named_for_the_arm_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, TOLD)
    made = new("lab", "--gripper", "rg2", "--robot", "ur10e", answers="192.0.2.7\n")
    assert made.exit_code == 0, made.output
    hosts = [cell.gripper.link and cell.gripper.link.host for cell in map(load_cell, ("cells/lab.toml", TWIN))]
    assert hosts == ["192.168.1.1", ""]


def test_what_the_controller_tells_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, TOLD)
    made = new("lab", answers="192.0.2.7\nur12e\n\n")
    assert made.exit_code == 0, made.output
    assert "3 of 5" not in made.output
    assert "found: ur10e or ur12e, serial number 20245500815, PolyScope 5.12.3.118" in made.output
    real = load_cell("cells/lab.toml")
    twin = load_cell(TWIN)
    assert twin.sim.polyscope == "5.12.3"
    assert (real.link.kind, real.link.host, real.link.serial) == ("ur", "192.0.2.7", "20245500815")
    assert (twin.link.kind, twin.link.serial) == ("sim", None)
    assert real.limits.tcp_speed_max == 1.0  # slow at first
    for cell in (real, twin):
        assert file_faults(f"cells/{cell.name}.toml") == []
        assert cell.robot.name == "ur12e"
        assert cell.tool.mass_kg == 1.25
        assert cell.tool.X_FT[:3, 3] == pytest.approx([0.0, 0.01, 0.2])


def test_a_controller_that_does_not_answer_is_told_and_everything_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, None)
    made = new("lab", answers="192.0.2.7\n\n\n\n\n")
    assert made.exit_code == 0, made.output
    assert "no controller answers at 192.0.2.7" in made.output
    assert file_faults("cells/lab.toml") == []


def test_options_answer_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLING_CELLS", "mine")
    made = new("--controller", "sim", "--robot", "ur20", "--tcp", "0.1", "--mass", "2", "--gripper", "tool_digital 1")
    assert made.exit_code == 0, made.output
    assert "of 5" not in made.output
    assert load_cell("mine/lab.toml").robot.name == "ur20"


@pytest.mark.parametrize(
    ("arguments", "answers", "words"),
    [
        (["../lab"], "", "no name of a cell"),
        (["lab", "--tcp", "170"], "", "170.0 is not in the range"),
        (["lab", "--mass", "90"], "sim\n\n\n\n", "these answers make no cell: tool.mass_kg"),
        (["lab", "--robot", "UR5"], "sim\n\n\n\n", "did you mean 'ur5'?"),
        (["lab", "--robot", "ur8long"], "sim\n\n\n\n", "not published: joint_velocity_deg_s"),
    ],
)
def test_what_makes_no_cell_is_refused_and_nothing_written(arguments: list[str], answers: str, words: str) -> None:
    made = new(*arguments, answers=answers)
    assert made.exit_code != 0
    assert words in made.output
    assert not Path("cells").exists()


def test_a_file_that_is_there_stays_and_is_named_before_any_question() -> None:
    Path("cells").mkdir()
    Path("cells/lab.toml").write_text("mine")
    made = new("lab")
    assert made.exit_code == 1
    assert "lab.toml is there already" in made.output
    assert "of 5" not in made.output
    assert Path("cells/lab.toml").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOT_NAMES)
@pytest.mark.parametrize(("tcp_m", "mass_kg"), [(0.17, 1.0), (0.0, 0.0), (0.3, 2.0)])
def test_every_arm_stands_at_home_and_plans_its_first_throw(name: str, tcp_m: float, mass_kg: float) -> None:
    """Also a short arm with a long tool, whose usual home would put it into the floor."""
    _, cell = cell_written("lab", Answers("sim", name, (0.0, 0.0, tcp_m, 0.0, 0.0, 0.0), mass_kg, "tool_digital 0"))
    assert home_faults(cell) == []
    throw = {"release": {"kind": "target", "position": first_target(cell)}, "time_limit_s": 30.0}
    assert plan(problem_from_request(throw, cell)).certificate.valid
