"""`--json` for machines: every command that answers something takes it, and writes one document with it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.support.client import ServiceClient
from executor.doctor import DoctorFinding, report_document
from executor.robot import FoundRobot
from tests.executor.conftest import Prepared, prepare

RUNS = "only runs processes, until Ctrl-C"
WITHOUT = {
    "up": RUNS,
    "serve": RUNS,
    "executor": RUNS,
    "sim": RUNS,
    "demo": "runs processes, for a person; `throw --json` is its throw",
}


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    return prepare("ur5e-sim")


def commands(command: click.Command, path: tuple[str, ...] = ()) -> Iterator[str]:
    """Yields what can be called of a tree of commands, by its words."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, (*path, name))
    if not isinstance(command, click.Group) or command.invoke_without_command:
        yield " ".join(path)


def fling(*arguments: str) -> Any:
    return CliRunner().invoke(main, arguments)


def answer(*arguments: str) -> Any:
    """Returns what a command with --json has written, which is one document."""
    done = fling(*arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.mark.parametrize("words", list(commands(main)))
def test_every_command_has_json_or_a_reason_to_have_none(words: str) -> None:
    lists_it = re.search(r"^ +--json ", fling(*words.split(), "--help").output, re.MULTILINE) is not None
    assert lists_it is (words not in WITHOUT)


@pytest.mark.parametrize("words", WITHOUT)
def test_what_only_runs_processes_refuses_json_by_name(words: str) -> None:
    name, command, rest = main.resolve_command(click.Context(main), [words, "--json"])
    assert command is not None
    with pytest.raises(click.NoSuchOption, match="--json"):
        command.make_context(name, rest)


@pytest.mark.parametrize(
    "arguments",
    [
        ["acknowledge", "--cell", "lab"],
        ["abort"],
        ["profile", "adopt", "7"],
        ["profile", "revert", "--cell", "lab"],
        ["robot", "power-on", "--cell", "lab"],
    ],
)
def test_what_a_service_answers_is_the_document(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    given = {
        "id": "7",
        "profile": "7",
        "adopted_by": "local",
        "cell": "lab",
        "state": "done",
        "text": "dashboard",
        "outcome": None,
        "fault": None,
    }
    for name in ("acknowledge", "abort", "post", "operate"):
        monkeypatch.setattr(ServiceClient, name, lambda *_: given)
    assert answer(*arguments) == given


def test_what_is_written_to_a_file_is_named(prepared: Prepared, tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    file.write_bytes(prepared.document)
    id = json.loads(prepared.document)["id"]
    assert answer("report", str(file)) == {"plan_id": id, "file": str(tmp_path / "plan.html")}
    made = tmp_path / "plan.script"
    assert answer("export", "--urscript", str(file)) == {"plan_id": id, "file": str(made)}
    assert made.read_text().startswith("#")


def test_a_new_cell_asks_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FLING_CELLS", raising=False)
    given = ["cell", "new", "lab", "--controller", "sim", "--robot", "ur5e", "--tcp", "0.1", "--mass", "1"]
    refused = fling(*given, "--json")
    assert (refused.exit_code, refused.stdout) == (64, "")
    assert "give --gripper" in json.loads(refused.stderr)["detail"]
    made = answer(*given, "--gripper", "tool_digital 0")
    assert (made["cell"], made["robot"], made["files"]) == ("lab", "ur5e", ["cells/lab.toml"])


def test_versions_of_a_cell_are_compared_and_restored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cell: Path
) -> None:
    monkeypatch.setenv("FLING_CELLS", str(cell.parent))
    monkeypatch.setenv("FLING_DATABASE_URL", f"sqlite:///{tmp_path / 'fling.db'}")
    same = answer("cell", "diff", "1", "--cell", "lab")
    assert same == {"cell": "lab", "before": 1, "after": None, "changes": [], "diff": ""}
    text = cell.read_text()
    cell.write_text(text.replace("mass_kg = 1.0", "mass_kg = 1.5"))
    other = answer("cell", "diff", "1", "--cell", "lab")
    assert other["changes"] == [{"key": "tool.mass_kg", "before": 1.0, "after": 1.5}]
    assert "+mass_kg = 1.5" in other["diff"]
    restored = answer("cell", "restore", "1", "--cell", "lab")
    assert restored == {"cell": "lab", "version": 1, "files": [str(cell)], "notes": []}
    assert cell.read_text() == text


def test_a_cell_is_exported_in_a_document(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLING_CELLS", str(cell.parent))
    made = answer("cell", "export", "--urdf", "--cell", "lab")
    assert (made["cell"], made["format"]) == ("lab", "urdf")
    assert made["text"] == fling("cell", "export", "--urdf", "--cell", "lab").stdout


def test_the_doctors_findings_are_a_document(prepared: Prepared) -> None:
    found = [DoctorFinding("link", "ok", "good"), DoctorFinding("jitter", "warning", "late", "end other programs")]
    document = json.loads(json.dumps(report_document(prepared.cell, FoundRobot(), found)))
    assert document["findings"][1] == {
        "name": "jitter",
        "grade": "warning",
        "text": "late",
        "advice": "end other programs",
    }
    assert (document["cell"], document["exit_status"]) == (prepared.cell.name, 1)


def test_the_doctor_is_asked_for_a_document(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr("api.cli.serve.os.execv", lambda _, arguments: asked.extend(arguments))
    assert fling("doctor", "--json").exit_code == 0
    assert asked[-3:] == ["executor", "--doctor", "--json"]
