"""A series from the command line, with a service of its own kind behind it."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.support.series import load_step, read_targets, series_text


def test_targets_are_read_a_line_each(tmp_path: Path):
    file = tmp_path / "targets.txt"
    file.write_text("# x y z\n1.2 0.3 0\n\n1.0, -0.2, 0.1  # the far corner\n")
    assert read_targets(file) == [(1.2, 0.3, 0.0), (1.0, -0.2, 0.1)]
    file.write_text("1.2 0.3\n")
    with pytest.raises(click.ClickException, match=r"line 1: '1\.2 0\.3' is not X Y Z"):
        read_targets(file)
    file.write_text("# nothing\n")
    with pytest.raises(click.ClickException, match="no targets"):
        read_targets(file)


class ScriptedService:
    """Stands in for the client of the service: answers states of the robot in turn, and executions by outcome."""

    def __init__(self, inputs: tuple[int, ...] = (), outcomes: tuple[str, ...] = ()) -> None:
        self.inputs, self.outcomes = list(inputs), list(outcomes)
        self.executed: list[dict[str, Any]] = []

    def __call__(self, url: str, token: str | None) -> ScriptedService:
        return self

    def __enter__(self) -> ScriptedService:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def get(self, path: str) -> Any:
        if path.startswith("/cells/"):
            return {"robot": {"digital_input_bits": self.inputs.pop(0)}}
        if path.startswith("/executions/"):
            return {"id": "x", "outcome": self.outcomes[len(self.executed) - 1], "reason": None}
        done = self.outcomes[: len(self.executed)]
        numbers = {"throws": len(done), "landed": 0, "median_distance_m": None, "largest_distance_m": None}
        whole = {**numbers, "mean_error_m": None, "outcomes": {outcome: done.count(outcome) for outcome in done}}
        return {"id": "e", "statistics": whole, "targets": [{**whole, "target": [1.2, 0.3, 0.0]}]}

    def planned(self, request: Any, trajectory: bool, progress: Any) -> Any:
        return {"id": str(request["release"]["position"][0]), "cell": "ur5e-sim"}

    def post(self, path: str, body: Any) -> Any:
        if path == "/experiments":
            self.settings = body["settings"]
            return {"id": "e"}
        self.executed.append(body)
        return {"id": str(len(self.executed))}

    def finished(self, id: str, on_event: Any) -> Any:
        return self.get(f"/executions/{id}")


def fling(monkeypatch: pytest.MonkeyPatch, script: ScriptedService, *arguments: str, typed: str = "") -> Any:
    monkeypatch.setattr("api.cli.support.client.ServiceClient", script)
    return CliRunner().invoke(main, ["throw", *arguments], input=typed)


def test_a_series_takes_the_targets_in_turns_and_loads_in_between(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    file = tmp_path / "targets.txt"
    script = ScriptedService(outcomes=("completed",) * 4)
    file.write_text("1.2 0.3 0\n1.0 0.1 0\n")
    options = ("--targets", str(file), "--repeat", "2", "--load", "enter", "--soonest", "--name", "n")
    result = fling(monkeypatch, script, *options, typed="\n\n\n")
    assert result.exit_code == 0, result.output
    assert [body["plan_id"] for body in script.executed] == ["1.2", "1.0", "1.2", "1.0"]
    assert {body["experiment_id"] for body in script.executed} == {"e"}
    assert result.output.count("load the next object") == 3
    assert [request["release_window_s"] for request in script.settings["requests"]] == [0.0, 0.0]


def test_a_series_ends_at_the_first_throw_that_is_not_completed(monkeypatch: pytest.MonkeyPatch):
    script = ScriptedService(outcomes=("completed", "late", "completed"))
    result = fling(monkeypatch, script, "1.2", "-0.3", "0", "--repeat", "3", "--json")
    assert result.exit_code == 4
    assert len(script.executed) == 2
    assert json.loads(result.stdout.splitlines()[-1])["statistics"]["outcomes"] == {"completed": 1, "late": 1}


@pytest.mark.parametrize(
    "arguments",
    [("1.2", "0.3"), ("1.2", "0.3", "0", "--targets", __file__), (), ("1", "0", "0", "--repeat", "2", "--dry-run")],
)
def test_a_wrong_command_line(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]):
    assert fling(monkeypatch, ScriptedService(), *arguments).exit_code == 64


def test_a_load_step_waits_for_an_input_to_go_on(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("time.sleep", lambda _: None)
    script = ScriptedService(inputs=(0b1000, 0b1000, 0b0110, 0b0110, 0b1000, 0b0000))
    load_step("input:3")(script, "ur5e-sim")
    assert script.inputs == [0b0000]  # on from before does not count


def test_a_load_step_calls_a_loader(tmp_path: Path):
    calls: list[str] = []

    class Loader(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            calls.append(self.path)
            self.send_response(204 if self.path == "/load" else 503)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            return

    server = HTTPServer(("127.0.0.1", 0), Loader)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        url = f"http://127.0.0.1:{server.server_port}"
        load_step(f"{url}/load")(None, "ur5e-sim")
        with pytest.raises(click.ClickException, match="answers 503"):
            load_step(f"{url}/empty")(None, "ur5e-sim")
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert calls == ["/load", "/empty"]


@pytest.mark.parametrize("text", ["input:99", "input:x", "key", "ftp://loader"])
def test_an_unknown_load_step_is_refused(text: str):
    with pytest.raises(click.UsageError, match="not one of"):
        load_step(text)


def test_the_table_has_a_line_a_target_and_one_for_all():
    row = {"throws": 3, "landed": 2, "median_distance_m": 0.0123, "largest_distance_m": 0.05}
    whole = {**row, "mean_error_m": [0.001, -0.0025]}
    lines = series_text({"targets": [{**whole, "target": [1.2, -0.3, 0.0]}], "statistics": whole}).splitlines()
    assert lines[1].split() == ["1.200", "-0.300", "0.000", "3", "2", "12.3", "50.0", "1.0,", "-2.5"]
    assert lines[2].split()[0] == "all"


def test_a_throw_after_which_a_fault_is_latched_says_what_to_do(monkeypatch: pytest.MonkeyPatch):
    for outcome, latched in (("link_lost", True), ("held", False), ("refused", False)):
        result = fling(monkeypatch, ScriptedService(outcomes=(outcome,)), "1.2", "0.3", "0", "--json")
        assert (result.exit_code, "'fling acknowledge'" in json.loads(result.stderr)["detail"]) == (4, latched)
