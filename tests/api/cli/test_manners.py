"""How the command line ends: sentences, suggestions, JSON, exit statuses, used addresses, and children that die."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.support.addresses import require_free
from api.cli.support.client import ServiceClient
from api.cli.support.errors import FlingGroup
from api.cli.support.processes import DEATHS_MAX, ChildFailed, ChildProcesses, Waiting

HOST = "127.0.45.3"
GRIPPER = 'output = "tool_digital"\nindex = 0\nopen_level = true'  # of the shipped cells


def fling(*arguments: str, **environment: str):
    return CliRunner().invoke(main, arguments, env=environment or None)


def up(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs `fling up` with a cell file, and nothing that it would start."""
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / "lab.toml").write_text(text)
    monkeypatch.setattr("api.cli.support.processes.start_all", lambda *_: None)
    monkeypatch.setattr("api.cli.support.processes.require_streaming_client", lambda: None)
    monkeypatch.setattr("api.cli.support.addresses.require_free", lambda *_: None)
    monkeypatch.setattr("api.cli.support.processes.catch_signals", lambda: None)
    monkeypatch.setattr("api.cli.serve._keep_alive", lambda _: None)
    settings = {"FLING_CELLS": str(tmp_path / "cells"), "FLING_DATABASE_URL": f"sqlite:///{tmp_path / 'fling.db'}"}
    return fling("up", "--cell", "lab", "--port", "8000", **settings)


def test_up_proposes_a_throw_of_its_own_arm(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    result = up((root / "cells" / "ur10e-sim.toml").read_text(), tmp_path, monkeypatch)
    assert result.exit_code == 0, result.output
    assert "\ntry: fling throw 1.8 0.3 0.0\n" in result.output


def test_up_names_every_fault_and_warning_of_its_cell(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text = (root / "cells" / "ur5e-sim.toml").read_text()
    spoilt = text.replace("mass_kg = 1.0", "mass_kg = -1.0").replace("\ndelay_s = 0.040", '\ndelay_s = "late"')
    result = up(spoilt, tmp_path, monkeypatch)
    assert result.exit_code == 1
    assert "2 faults" in result.stderr
    assert "tool.mass_kg" in result.stderr
    assert "gripper.delay_s" in result.stderr
    shutil.rmtree(tmp_path / "cells")
    result = up(text.replace("clearance_m = 0.02", "clearance_m = 0.0"), tmp_path, monkeypatch)
    assert result.exit_code == 0, result.output
    assert "lab: surroundings.clearance_m is 0 m" in result.output


def test_a_database_of_another_version_is_a_sentence(tmp_path: Path):
    url = f"sqlite:///{tmp_path / 'fling.db'}"
    assert fling("db", "upgrade", "--database-url", url).exit_code == 0
    with sqlite3.connect(tmp_path / "fling.db") as connection:
        connection.execute("INSERT INTO schema_steps (number) VALUES (99)")
    sweep = tmp_path / "sweep.json"
    sweep.write_text('{"requests": [{"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}]}')
    for command in (["batch", str(sweep)], ["db", "upgrade"], ["cell", "history"]):
        result = fling(*command, FLING_DATABASE_URL=url)
        assert result.exit_code == 1, command
        assert re.search(r"^fling: the database is at version \d+; .* install a newer version$", result.stderr), command


def test_a_wait_says_what_it_is_for(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    clock = iter([100.0, 101.0, 103.5, 105.0, 107.5, 111.0])
    monkeypatch.setattr("api.cli.support.processes.time.monotonic", lambda: next(clock))
    waiting = Waiting(10.0)
    assert [waiting.goes_on("the executor connects") for _ in range(5)] == [True, True, True, True, False]
    told = "  4 s: the executor connects …\n  8 s: the executor connects …\n"
    assert capsys.readouterr().out == told


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [(["trow", "1", "2", "3"], "throw"), (["cell", "chek"], "check"), (["serv"], "serve")],
)
def test_a_mistyped_command_gets_a_suggestion(arguments: list[str], hint: str):
    result = fling(*arguments)
    assert result.exit_code == 64
    assert f"did you mean {hint}" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["frobnicate"], 64, "there is no command 'frobnicate'"),
        (["throw", "--repet", "3"], 64, "--repeat"),
        (["throw", "1", "2"], 64, "give X Y Z"),
        (["throw", "1", "0", "0", "--load", "gravity"], 64, "--load 'gravity' is not one of"),
        (["up", "--port", "99999"], 64, "--port"),
        (["up", "--patience", "0"], 64, "--patience"),
        (["serve", "--planner-workers", "0"], 64, "--planner-workers"),
        (["map", "--out", "map.pdf"], 64, "a map is written as"),
        (["cell", "check"], 64, "Missing argument 'FILE ...'"),
        (["plan", "missing.json"], 1, "missing.json"),
        (["throw", "1", "0", "0", "--url", f"http://{HOST}:9"], 1, "start one with 'fling up'"),
        (["up", "--cell", "nowhere"], 1, "the folder of cell files (FLING_CELLS)"),
        (["doctor", "--cell", "nowhere"], 1, "the folder of cell files (FLING_CELLS)"),
        (["executor", "--cell", "nowhere"], 1, "the folder of cell files (FLING_CELLS)"),
        (["db", "upgrade", "--database-url", "nonsense"], 1, "the database cannot be reached"),
    ],
)
def test_every_error_is_one_sentence_or_one_document(arguments: list[str], status: int, words: str):
    result = fling(*arguments)
    assert (result.exit_code, words in result.stderr) == (status, True), result.stderr
    assert result.stdout in ("", "planning …\n")
    assert "Traceback" not in result.stderr
    if arguments[0] not in ("plan", "up", "serve", "executor"):  # answers in JSON always, or never
        document = json.loads(fling(*arguments, "--json").stderr)
        assert document["exit_status"] == status
        assert words in document["detail"]


def test_wrong_settings_are_one_sentence():
    result = fling("serve", FLING_PORT="eighty")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "FLING_PORT: must be a whole number; it is 'eighty'" in result.stderr


def test_a_bug_keeps_its_traceback():
    @click.group(cls=FlingGroup)
    def group() -> None: ...

    @group.command()
    def buggy() -> None:
        raise ZeroDivisionError

    assert isinstance(CliRunner().invoke(group, ["buggy"]).exception, ZeroDivisionError)


def test_an_interrupt_is_no_traceback():
    @click.group(cls=FlingGroup)
    def group() -> None: ...

    @group.command()
    def waiting() -> None:
        raise KeyboardInterrupt

    result = CliRunner().invoke(group, ["waiting"])
    assert (result.exit_code, result.stderr.strip()) == (130, "fling: interrupted")


def test_cell_check_names_every_fault_at_once(tmp_path: Path):
    file = tmp_path / "bad.toml"
    file.write_text('robot = "ur5e"\nsurprise = 1\n[tool]\nmass_kg = -1\n[link]\nkind = "wish"\n')
    result = fling("cell", "check", str(file))
    assert result.exit_code == 1
    assert all(word in result.stderr for word in ("3 faults", "surprise", "tool.mass_kg = -1", "link.kind = 'wish'"))
    document = json.loads(fling("cell", "check", str(file), "--json").stderr)
    assert [error["field"] for error in document["errors"]] == ["surprise", "tool.mass_kg", "link.kind"]


def test_cell_check_takes_several_files(tmp_path: Path, root: Path):
    good = [str(root / "cells" / f"{name}.toml") for name in ("ur5e-sim", "ur3e-sim")]
    answers = fling("cell", "check", *good, "--json").stdout.splitlines()
    assert [json.loads(line)["cell"] for line in answers] == ["ur5e-sim", "ur3e-sim"]
    bad = tmp_path / "bad.toml"
    bad.write_text('robot = "ur5e"\nhome_rad = 1979-05-27\n[link]\nkind = "sim"\n')
    result = fling("cell", "check", good[0], str(bad), str(tmp_path), good[1])
    assert result.exit_code == 1
    assert result.stdout.count(": good.") == 2
    assert f"{bad} has a fault" in result.stderr
    assert f"{tmp_path} has a fault" in result.stderr
    document = json.loads(fling("cell", "check", *good, str(bad), "--json").stderr)
    assert document["errors"] == [
        {
            "file": str(bad),
            "field": "home_rad",
            "value": "datetime.date(1979, 5, 27)",
            "reason": "must be a list of 6 numbers",
        }
    ]


HANDED_OVER = {
    "cell": ["cell", "check"],
    "request": ["plan"],
    "batch": ["batch"],
    "job": ["job"],
    "recording": ["calibrate", "lag", "--from-csv"],
    "plan": ["report"],
    "targets": ["throw", "--targets"],
    "profile": ["sim", "--cell", "ur5e-sim", "--profile"],
}


@pytest.mark.parametrize("command", HANDED_OVER.values(), ids=HANDED_OVER)
@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "garbage", "deep", "digits", "nothing"])
def test_whatever_is_handed_over_is_read_or_refused_in_a_sentence(tmp_path: Path, command: list[str], kind: str):
    file = tmp_path / "handed-over.toml"
    contents = {
        "garbage": bytes(range(256)) * 100,
        "deep": b"[" * 100_000,
        "digits": b"a = " + b"9" * 6000,
        "nothing": b"",
    }
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    elif kind == "device":
        file = Path("/dev/zero")
    else:
        file.write_bytes(contents[kind])
    result = fling(*command, str(file))
    assert result.exit_code in (1, 64), result.output
    assert isinstance(result.exception, SystemExit), result.exception
    assert 0 < len(result.stderr.strip()) < 1500


def test_cell_check_names_every_violation_at_home(tmp_path: Path, root: Path):
    text = (root / "cells" / "ur5e-sim.toml").read_text().replace("floor_z_m = 0.0", "floor_z_m = 2.0")
    file = tmp_path / "low.toml"
    file.write_text(text)
    assert "violates floor" in fling("cell", "check", str(file)).stderr


def test_cell_check_warns_of_a_box_in_millimetres(tmp_path: Path, root: Path):
    boxes = "keep_out = [{lower_m = [0.8, -0.5, 0.0], upper_m = [0.82, 0.5, 0.6]}, {lower_m = %s, upper_m = %s}]"
    text = (root / "cells" / "ur5e-sim.toml").read_text()
    file = tmp_path / "walled.toml"
    file.write_text(text.replace("keep_out = []", boxes % ([800, -500, 0], [820, 500, 600])))
    result = fling("cell", "check", str(file))
    assert result.exit_code == 0
    assert "box 1 is 800 m from the arm" in result.stdout
    assert "box 0" not in result.stdout
    assert len(json.loads(fling("cell", "check", str(file), "--json").stdout)["warnings"]) == 1


@pytest.mark.parametrize(
    ("changes", "warning"),
    [
        ({"lag_s = 0.02  ": "lag_s = 0.0  "}, "the simulated arm is 0.02 s late (sim.lag_s)"),
        ({"lag_s = 0.02  ": "lag_s = 0.0  ", 'kind = "sim"': 'kind = "ur"'}, "fling calibrate lag --cell changed"),
        ({"floor_z_m = 0.0": "floor_z_m = -750.0"}, "surroundings.floor_z_m is 750 m below the arm: metres?"),
        ({"mass_kg = 0.05": "mass_kg = 4.0"}, None),
        ({'host = "127.0.0.1"': 'host = "8.8.8.8"'}, "8.8.8.8 (link.host) is not this machine"),
        ({GRIPPER: 'kind = "robotiq"\nmodel = "2f85"\nhost = "192.168.1.1"'}, "leave gripper.host out"),
        ({'host = "127.0.0.1"': 'host = "localhost"'}, None),
    ],
)
def test_cell_check_warns_of_what_is_allowed_and_unlikely(tmp_path: Path, root: Path, changes, warning):
    text = (root / "cells" / "ur5e-sim.toml").read_text()
    file = tmp_path / "changed.toml"
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)
    found = json.loads(fling("cell", "check", str(file), "--json").stdout)["warnings"]
    assert [warning in each for each in found] == [True] * (warning is not None)


def test_cell_check_warns_of_a_simulated_arm_that_calls_elsewhere(tmp_path: Path, root: Path):
    file = tmp_path / "changed.toml"
    calls = 'kind = "http"\njitter_s = 0.01\nopen_url = "http://8.8.8.8/o"\nclose_url = "http://8.8.8.8/c"'
    text = (root / "cells" / "ur5e-sim.toml").read_text()
    file.write_text(text.replace(GRIPPER, calls).replace("jitter_s = 0.0015", ""))
    said = fling("cell", "check", str(file)).output
    assert "the gripper at 8.8.8.8 is not: name 127.0.0.1 in both URLs" in said


def test_cell_check_in_json(root: Path):
    answer = json.loads(fling("cell", "check", str(root / "cells" / "ur5e-sim.toml"), "--json").stdout)
    assert (answer["cell"], answer["robot"], answer["link"]) == ("ur5e-sim", "ur5e", "sim")
    assert json.loads(fling("version", "--json").stdout)["version"]


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.create_server((HOST, 0)) as server:
        yield server.getsockname()[1]


def test_a_used_address_is_named_with_its_user_and_a_way_out(taken: int):
    with pytest.raises(click.ClickException) as refused:
        require_free(HOST, [taken], "the service", "or choose another port: --port")
    assert f"the service cannot listen on {HOST}:{taken}: it is used by process {os.getpid()}" in refused.value.message
    assert refused.value.message.endswith("stop it; or choose another port: --port")
    result = fling("serve", "--host", HOST, "--port", str(taken))
    assert (result.exit_code, f"{HOST}:{taken}" in result.stderr) == (1, True)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(click.ClickException, match=r"203\.0\.113\.1:8000: "):
        require_free("203.0.113.1", [8000], "the service", "or choose another")


def test_the_simulator_names_the_port_that_is_used():
    with socket.create_server((HOST, 29999)):
        result = fling("sim", "--host", HOST)
    assert result.exit_code == 1
    assert f"{HOST}:29999" in result.stderr
    assert "--host 127.0.0.2" in result.stderr


@pytest.fixture
def children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ChildProcesses]:
    (tmp_path / "lazy_child.py").write_text("import time\nprint('ready', flush=True)\ntime.sleep(600)\n")
    (tmp_path / "dying_child.py").write_text("raise SystemExit(3)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with ChildProcesses({}) as found:
        yield found


def revived(children: ChildProcesses) -> list[str]:
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        if sentences := children.revive():
            return sentences
        time.sleep(0.02)
    raise AssertionError("no child ended")


def test_a_child_that_died_is_started_again_and_named(children: ChildProcesses):
    children.start("executor", "lazy_child", ready_s=20.0)
    assert children.revive() == []
    first = children._children[0].process
    first.send_signal(signal.SIGKILL)
    assert revived(children) == ["the executor was ended by signal 9; started again"]
    second = children._children[0].process
    assert second.pid != first.pid
    assert second.poll() is None


def test_a_child_that_dies_again_and_again_does_not_come_back(children: ChildProcesses):
    children.start("service", "dying_child")
    for _ in range(DEATHS_MAX):
        assert revived(children) == ["the service ended with status 3; started again"]
    with pytest.raises(ChildFailed, match="the service ended with status 3, the 4th time within 60 s"):
        revived(children)


def test_without_a_client_for_the_controller_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr("api.cli.support.processes.find_spec", lambda name: None)
    result = CliRunner().invoke(main, ["demo", "--keep", str(tmp_path / "demo")])
    assert result.exit_code == 1
    assert result.output.startswith("fling: ur_rtde is not installed")
    assert "pip install 'fling-robotics[executor]'" in result.output
    assert len(result.output.splitlines()) == 1


def test_the_version_is_an_option_too():
    result = CliRunner().invoke(main, ["--version"])
    assert (result.exit_code, result.output) == (0, CliRunner().invoke(main, ["version"]).output)


def test_a_fault_is_acknowledged_once_the_executor_has_cleared_it(monkeypatch: pytest.MonkeyPatch):
    asked = []
    faults = [{"outcome": "late"}, {"outcome": "late"}, None]
    monkeypatch.setattr(ServiceClient, "post", lambda _, path: asked.append(path) or {"fault": faults[0]})
    monkeypatch.setattr(ServiceClient, "get", lambda _, path: asked.append(path) or {"fault": faults.pop(0)})
    with ServiceClient("http://127.0.0.1:9", None) as client:
        assert client.acknowledge("ur5e-sim") == {"fault": {"outcome": "late"}}
    assert asked == ["/cells/ur5e-sim/acknowledge", *["/cells/ur5e-sim/state"] * 3]
    assert faults == []


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (None, "ur5e-sim: there was no fault"),
        ({"outcome": "late", "reason": "busy"}, "ur5e-sim: late: busy; acknowledged by local"),
    ],
)
def test_an_acknowledgement_says_what_it_cleared(fault: Any, said: str, monkeypatch: pytest.MonkeyPatch):
    answer = {"cell": "ur5e-sim", "acknowledged_by": "local", "fault": fault}
    monkeypatch.setattr(ServiceClient, "acknowledge", lambda *_: answer)
    result = CliRunner().invoke(main, ["acknowledge", "--cell", "ur5e-sim"])
    assert (result.exit_code, result.output.strip()) == (0, said)
