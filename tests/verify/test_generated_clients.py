"""Clients that are generated from the OpenAPI document run a throw, read every document and provoke the errors.

Each is told nothing but the document: an answer that it does not declare, or declares wrongly, ends the run.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from api.http import create_token
from tests.verify.conftest import READY_S

pytestmark = pytest.mark.slow
HOST = "127.0.41.7"
CONTROLLER = "127.0.41.8"
TRIES = 3  # on an overloaded machine a throw may be `late`
NO_ID = "00000000-0000-7000-8000-000000000000"  # of nothing
TYPESCRIPT = Path(__file__).parent / "typescript_client"
MAP_S = 240.0  # [s] for four throws, after planner processes have been started on a busy machine
MAP = {"extent_m": [1.0, 1.4, 0.1, 0.5], "resolution_m": 0.2, "plane_z_m": 0.0}
JOINT = {
    "kind": "joint",
    "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
    "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
}
POWER_ON = {"action": "power_on"}  # it has power: nothing changes


@dataclass(frozen=True)
class RunningCell:
    """Service, executor and simulated controller, with tokens."""

    url: str
    tokens: dict[str, str]
    folder: Path

    def get(self, path: str) -> Any:
        """Returns a document, with the token that may do everything."""
        headers = {"Authorization": f"Bearer {self.tokens['both']}"}
        with urlopen(Request(self.url + path, headers=headers), timeout=10.0) as answer:
            return json.load(answer)


@pytest.fixture(scope="module")
def running_cell(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[RunningCell]:
    folder = tmp_path_factory.mktemp("running")
    cells = tmp_path_factory.mktemp("cells")
    text = (request.config.rootpath / "cells" / "ur5e-sim.toml").read_text()
    (cells / "ur5e-sim.toml").write_text(re.sub(r'host = "[^"]*"', f'host = "{CONTROLLER}"', text))
    (cells / "spare.toml").write_text(text)
    scopes = {"both": ("plan", "operate"), "planner": ("plan",)}
    tokens = {name: create_token(folder / "tokens.toml", name, scope) for name, scope in scopes.items()}
    with socket.create_server((HOST, 0)) as free:
        port = free.getsockname()[1]
    environment = {
        **os.environ, "FLING_HOST": HOST, "FLING_PORT": str(port), "FLING_CELLS": str(cells),
        "FLING_TOKENS_FILE": str(folder / "tokens.toml"), "FLING_DATA": str(folder / "data"),
        "FLING_DATABASE_URL": f"sqlite:///{folder / 'fling.db'}",
    }  # fmt: skip
    with (folder / "up.log").open("w") as log:
        command = [str(Path(sys.executable).with_name("fling")), "up", "--patience", str(READY_S)]
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        try:
            found = RunningCell(f"http://{HOST}:{port}", tokens, folder)
            _wait_until_ready(found, process)
            yield found
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60.0)


def _wait_until_ready(cell: RunningCell, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        assert process.poll() is None, (cell.folder / "up.log").read_text()
        try:
            if cell.get("/readyz")["cells"]["ur5e-sim"]:
                return
        except (OSError, HTTPError):
            pass
        time.sleep(0.5)
    raise AssertionError((cell.folder / "up.log").read_text())


@pytest.fixture(scope="module")
def document(running_cell: RunningCell) -> dict[str, Any]:
    return running_cell.get("/openapi.json")


class PythonClient:
    """The client that openapi-python-client generates, called by operation id."""

    def __init__(self, package: ModuleType, url: str, token: str | None) -> None:
        self._package = package
        made = importlib.import_module(f"{package.__name__}.client")
        self._client = made.Client(url, timeout=150.0) if token is None else made.AuthenticatedClient(url, token)
        self._client = self._client.with_timeout(importlib.import_module("httpx").Timeout(150.0))
        names = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        self._calls = {name.rpartition(".")[2]: name for _, name, is_package in names if not is_package}
        self.called: set[str] = set()

    def __enter__(self) -> PythonClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.get_httpx_client().close()

    def body(self, model: str, content: dict[str, Any]) -> Any:
        """Returns the model of a request's body."""
        return getattr(importlib.import_module(f"{self._package.__name__}.models"), model).from_dict(content)

    def call(self, operation: str, status: int, *path: str, **arguments: Any) -> Any:
        """Returns the parsed answer; the status must be the expected one, and the answer declared."""
        module = importlib.import_module(self._calls[operation])
        answer = module.sync_detailed(*path, client=self._client, **arguments)
        assert answer.status_code == status, (operation, answer.status_code, answer.content[:500])
        assert answer.parsed is not None, (operation, status, "is not declared")
        self.called.add(operation)
        if status >= 400:
            assert answer.parsed.status == status
            assert answer.parsed.type_.startswith("/problems/")
        return answer.parsed


@pytest.fixture(scope="module")
def python_package(document: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    pytest.importorskip("openapi_python_client", reason="NOT INSTALLED: openapi-python-client (requirements/verify.in)")
    folder = tmp_path_factory.mktemp("python")
    (folder / "openapi.json").write_text(json.dumps(document))
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    command += ["--path", "openapi.json", "--output-path", "fling_generated"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Unable to parse" not in done.stdout + done.stderr
    sys.path.insert(0, str(folder))
    yield importlib.import_module("fling_generated")
    sys.path.remove(str(folder))


def test_a_generated_python_client(running_cell: RunningCell, document: dict[str, Any], python_package: ModuleType):
    with PythonClient(python_package, running_cell.url, running_cell.tokens["both"]) as client:
        plan, execution, experiment = _throw(client)
        _plan_many(client)
        _map(client)
        _read_everything(client, plan, execution, experiment)
        _provoke(client, plan)
    operations = {op["operationId"]: op for methods in document["paths"].values() for op in methods.values()}
    assert set(operations) <= client.called
    with PythonClient(python_package, running_cell.url, None) as nobody:
        _without_token(nobody, document)
    with PythonClient(python_package, running_cell.url, running_cell.tokens["planner"]) as planner:
        planner.call("execute_plan", 403, body=planner.body("ExecuteRequest", {"plan_id": plan}))


def _throw(client: PythonClient) -> tuple[str, str, str]:
    """Plans, executes, watches to the end and reports a landing. Returns the ids of plan, execution and experiment."""
    target = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
    plan = client.call("make_plan", 201, body=client.body("PlanRequest", target))
    preview = client.call("make_plan", 200, body=client.body("PlanRequest", {"release": JOINT}), store=False)
    assert len(preview.trajectory.positions) > 10
    for _ in range(TRIES):
        experiment = client.call("begin_experiment", 201, body=client.body("ExperimentRequest", {"name": "generated"}))
        body = client.body("ExecuteRequest", {"plan_id": plan.id, "experiment_id": experiment.id})
        execution = client.call("execute_plan", 202, body=body)
        assert client.call("execute_plan", 409, body=body).type_ == "/problems/robot-busy"
        events = client.call("watch_execution", 200, execution.id)
        row = client.call("read_execution", 200, execution.id)
        if row.outcome == "completed":
            break
        client.call("acknowledge_fault", 200, "ur5e-sim")
    assert "event: telemetry" in events
    assert row.outcome == "completed", row
    assert row.metrics.landing_error_m < 0.01
    landing = {"position": list(row.metrics.landing_point), "std_m": 0.01}
    client.call("report_landing", 201, execution.id, body=client.body("LandingRequest", landing))
    return plan.id, execution.id, experiment.id


def _plan_many(client: PythonClient) -> None:
    """Plans a batch, watches it to the end and reads its results."""
    grid = {"release.positions[0]": [0.4, 0.42, 0.01], "backend": {"values": ["ruckig"]}}
    body = client.body("BatchRequest", {"template": {"release": JOINT}, "grid": grid})
    batch = client.call("make_batch", 201, body=body)
    assert "event: progress" in client.call("watch_batch", 200, batch.id)
    assert client.call("read_batch", 200, batch.id).counts.additional_properties == {"planned": 3}
    assert [result.number for result in client.call("read_batch_results", 200, batch.id).results] == [0, 1, 2]
    client.call("cancel_batch", 202, batch.id)
    client.call("list_batches", 200)
    wrong = client.body("BatchRequest", {"template": {"release": JOINT}, "grid": {"release.nothing": [0, 1, 1]}})
    assert client.call("make_batch", 422, body=wrong).errors[0].field == "requests[0].release.nothing"


def _map(client: PythonClient) -> None:
    """Has a small map made and reads it."""
    begun = client.call("make_cell_map", 202, "ur5e-sim", body=client.body("MapBody", MAP))
    deadline = time.monotonic() + MAP_S
    while (made := client.call("read_cell_map", 200, "ur5e-sim", id=begun.id)).state == "running":
        assert time.monotonic() < deadline, made
        time.sleep(0.5)
    assert (made.state, made.progress.done) == ("finished", 4)
    assert made.values.state == [[1, 1], [1, 1]]
    assert all(client.call("read_plan", 200, plan).id == plan for row in made.plans for plan in row)
    client.call("cancel_cell_map", 202, "ur5e-sim", id=begun.id)
    wrong = client.body("MapBody", {**MAP, "resolution_m": 0.0001})
    assert client.call("make_cell_map", 422, "ur5e-sim", body=wrong).errors[0].field == "resolution_m"
    client.call("make_cell_map", 404, "nowhere", body=client.body("MapBody", MAP))
    client.call("read_cell_map", 406, "ur5e-sim", accept="image/gif")


def _read_everything(client: PythonClient, plan: str, execution: str, experiment: str) -> None:
    cell = "ur5e-sim"
    for operation in ("list_plans", "list_executions", "list_experiments", "list_cells"):
        client.call(operation, 200)
    for operation in ("read_health", "read_readiness", "read_metrics"):
        client.call(operation, 200)
    assert client.call("read_plan", 200, plan).id == plan
    assert len(client.call("read_plan_curves", 200, plan).curves) > 10
    assert len(client.call("read_trajectory", 200, plan).positions) > 100
    assert client.call("read_recording", 200, execution).payload.read(5) == b"\x89MCAP"
    assert len(client.call("read_landings", 200, execution).landings) == 2  # the camera's, and the reported one
    assert client.call("read_experiment", 200, experiment).statistics.landed == 1
    assert len(client.call("read_cell_model", 200, cell).capsules) == 11
    assert client.call("read_robot_state", 200, cell).robot.connected is True
    for operation in ("read_cell", "read_timing", "read_calibration", "read_history", "list_profiles"):
        client.call(operation, 200, cell)
    client.call("acknowledge_fault", 200, cell)
    asked = client.call("operate_robot", 202, cell, body=client.body("RobotActionRequest", POWER_ON))
    assert (asked.action, asked.state) == ("power_on", "waiting")
    profile = client.call("estimate_profile_of_cell", 201, cell)
    client.call("read_profile", 200, profile.id)
    client.call("adopt_profile", 200, profile.id)
    assert client.call("execute_plan", 409, body=client.body("ExecuteRequest", {"plan_id": plan})).type_ == (
        "/problems/plan-not-executable"
    )
    client.call("revert_profile", 200, cell)
    client.call("abort_execution", 202, execution)


def _provoke(client: PythonClient, plan: str) -> None:
    """Every kind of refusal that a client can bring about."""

    def refused(status: int, **content: Any) -> Any:
        return client.call("make_plan", status, body=client.body("PlanRequest", {"release": JOINT, **content}))

    assert refused(422, limits={"velocity": 99.0}).errors[0].field == "limits.velocity[0]"
    fast = refused(422, release={**JOINT, "velocities": [9.0, 0.0, 0.0, 0.0, 0.0, 0.0]})
    assert (fast.type_, fast.violations[0].constraint) == ("/problems/infeasible", "joint_velocity")
    refused(404, cell="nowhere")
    refused(409, cell="spare", start={"current": True})
    hard = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    ended = refused(503, release=hard, backend="casadi", time_limit_s=0.001)
    assert (ended.type_, ended.solver.status) == ("/problems/solver-failed", "time_limit")
    client.call("make_plan", 422, body=client.body("PlanRequest", {"release": JOINT}), store=False, idempotency_key="x")
    client.call("read_trajectory", 406, plan, accept="image/png")
    client.call("list_plans", 422, cursor="x")
    for operation in ("read_plan", "read_plan_curves", "read_trajectory", "read_execution", "read_recording",
                      "watch_execution", "read_landings", "abort_execution", "read_experiment", "read_profile",
                      "adopt_profile", "read_batch", "watch_batch", "read_batch_results", "cancel_batch"):  # fmt: skip
        assert client.call(operation, 404, NO_ID).type_ == "/problems/not-found"
    for operation in ("read_cell", "read_cell_model", "read_robot_state", "read_timing", "read_history",
                      "read_calibration", "list_profiles", "acknowledge_fault", "estimate_profile_of_cell",
                      "revert_profile", "read_cell_map", "cancel_cell_map"):  # fmt: skip
        client.call(operation, 404, "nowhere")
    client.call("acknowledge_fault", 409, "spare")
    client.call("operate_robot", 409, "spare", body=client.body("RobotActionRequest", POWER_ON))


def _without_token(client: PythonClient, document: dict[str, Any]) -> None:
    """Every guarded operation asks for a token."""
    bodies = {
        "make_plan": ("PlanRequest", {"release": JOINT}),
        "execute_plan": ("ExecuteRequest", {"plan_id": "latest"}),
        "begin_experiment": ("ExperimentRequest", {}),
        "make_batch": ("BatchRequest", {"requests": [{"release": JOINT}]}),
        "make_cell_map": ("MapBody", {}),
        "report_landing": ("LandingRequest", {"result": "hit", "radius_m": 0.1}),
        "operate_robot": ("RobotActionRequest", POWER_ON),
        "replace_plan": ("ReplaceRequest", {"plan_id": "latest"}),
        "retarget_motion": ("RetargetRequest", {"release": JOINT}),
    }
    for path, methods in document["paths"].items():
        for operation in (op for op in methods.values() if "security" in op):
            name = operation["operationId"]
            there = ["ur5e-sim" if "{name}" in path else NO_ID] * path.count("{")
            body = {"body": client.body(*bodies[name])} if name in bodies else {}
            assert client.call(name, 401, *there, **body).type_ == "/problems/unauthenticated"


@pytest.mark.skipif(shutil.which("npm") is None, reason="NOT INSTALLED: Node, for the generated TypeScript client")
def test_a_generated_typescript_client(running_cell: RunningCell, document: dict[str, Any], tmp_path: Path):
    folder = tmp_path / "client"
    shutil.copytree(TYPESCRIPT, folder, ignore=shutil.ignore_patterns("node_modules", "build"))
    (folder / "openapi.json").write_text(json.dumps(document))
    ids = [op["operationId"] for methods in document["paths"].values() for op in methods.values()]
    for command in (
        ["npm", "ci", "--silent"],
        ["npx", "openapi-typescript", "openapi.json", "--output", "schema.d.ts"],
        ["npx", "tsc", "--project", "."],
        ["node", "build/client.js", running_cell.url, running_cell.tokens["both"], *ids],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command[:2]}: {done.stdout}{done.stderr}"
