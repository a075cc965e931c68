"""One throw as a user makes it: `fling up`, then HTTP only."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import psutil
import pytest
from click.testing import CliRunner

from api.cli import main

ROOT = Path(__file__).parents[2]
TARGET_M = [1.2, 0.3, 0.0]
UP_WITHIN_S = 90.0
DOWN_WITHIN_S = 30.0
ACKNOWLEDGED_S = 5.0
THROWS_MAX = 3  # on an overloaded machine the outcome may be `late`


class Up:
    """A running `fling up` on addresses of its own."""

    def __init__(self, folder: Path) -> None:
        pid = os.getpid()
        host = f"127.{90 + pid % 10}.{pid >> 8 & 255}.{pid & 255 or 1}"
        text = (ROOT / "cells" / "ur5e-sim.toml").read_text()
        (folder / "ur5e-sim.toml").write_text(re.sub(r'host = "127[^"]*"', f'host = "{host}"', text))
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.port = server.getsockname()[1]
        environment = {
            **os.environ, "FLING_CELLS": str(folder), "FLING_DATABASE_URL": f"sqlite:///{folder / 'fling.db'}",
            "FLING_DATA": str(folder), "FLING_PLANNER_WORKERS": "1",
        }  # fmt: skip
        command = [sys.executable, "-c", "from api.cli import main; main()", "up", "--port", str(self.port)]
        self.process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        deadline = time.monotonic() + UP_WITHIN_S
        for line in self.process.stdout:
            assert time.monotonic() < deadline
            if line.startswith("Fling is up"):
                break
        self.children = psutil.Process(self.process.pid).children(recursive=True)
        self.http = httpx2.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=60.0, trust_env=False)

    def down(self) -> int:
        """Presses Ctrl-C; returns the exit status."""
        self.http.close()
        self.process.send_signal(signal.SIGINT)
        status = self.process.wait(DOWN_WITHIN_S)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    running = Up(tmp_path_factory.mktemp("up"))
    yield running
    if running.process.poll() is None:
        running.down()


def executed(http: httpx2.Client, plan_id: str) -> dict[str, Any]:
    """Acknowledges a latched fault, executes, and waits for the end."""
    http.post("/cells/ur5e-sim/acknowledge")
    deadline = time.monotonic() + ACKNOWLEDGED_S
    while http.get("/cells/ur5e-sim/state").json()["fault"] is not None and time.monotonic() < deadline:
        time.sleep(0.05)
    response = http.post("/execute", json={"plan_id": plan_id})
    assert response.status_code == 202, response.text
    id = response.json()["id"]
    text = http.get(f"/executions/{id}/events").text  # ends with the execution
    assert "event: telemetry" in text
    return http.get(f"/executions/{id}").json()


def test_a_throw_lands_where_the_plan_said(up: Up):
    plan = up.http.post("/plan", json={"release": {"kind": "target", "position": TARGET_M}}).json()
    run = executed(up.http, plan["id"])
    for _ in range(THROWS_MAX - 1):
        if run["outcome"] == "late":
            run = executed(up.http, plan["id"])
    assert (run["state"], run["outcome"]) == ("finished", "completed"), run["reason"]
    metrics = run["metrics"]
    assert metrics["release_velocity_error_share"] < 0.01
    assert math.dist(metrics["landing_point"], TARGET_M) < 0.010
    assert up.http.get(f"/executions/{run['id']}/recording").content.startswith(b"\x89MCAP0\r\n")
    rows = up.http.get(f"/executions/{run['id']}/recording", headers={"Accept": "text/csv"}).text.splitlines()
    assert len(rows) == metrics["ticks"] + 1


def test_healthz_answers_while_it_solves(up: Up):
    far = {"release": {"kind": "target", "position": [6.0, 0.0, 0.0]}, "time_limit_s": 5.0}
    with httpx2.Client(base_url=up.http.base_url, timeout=60.0, trust_env=False) as other:
        import threading

        answer: list[int] = []
        solving = threading.Thread(target=lambda: answer.append(other.post("/plan", json=far).status_code))
        solving.start()
        while solving.is_alive():
            assert up.http.get("/healthz").status_code == 200
        solving.join()
    assert answer == [422]


def test_from_where_it_stands_now(up: Up):
    request = {"start": {"current": True}, "release": {"kind": "target", "position": [1.1, -0.2, 0.0]}}
    plan = up.http.post("/plan", json=request).json()
    state = up.http.get("/cells/ur5e-sim/state").json()
    assert math.dist(plan["trajectory"]["positions"][0], state["robot"]["positions"]) < 1e-3


def test_calibrate_lag_measures_it_with_motions_of_its_own(up: Up):
    """Small ones, at rest at the end; the simulated arm lags 20 ms, as the cell file says."""
    up.http.post("/cells/ur5e-sim/acknowledge")
    arguments = ["calibrate", "lag", "--cell", "ur5e-sim", "--throws", "2", "--json", "--url", str(up.http.base_url)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["lag_s"] == pytest.approx(0.020, abs=0.001)
    assert found["gain"] == pytest.approx([1.0] * 6, abs=0.01)
    assert (found["runs"], found["lag_change_s"]) == (2, None)
    timing = up.http.get("/cells/ur5e-sim/timing").json()
    assert timing["runs"][0]["execution_id"] == up.http.get("/executions/latest").json()["id"]
    assert timing["pooled"]["lag_s"] == pytest.approx(0.020, abs=0.001)


@pytest.mark.slow
def test_what_was_learnt_is_adopted_used_and_given_up_again(up: Up):
    """From the landings of the throws before; a plan made before the adoption is not executable any more."""
    before = up.http.post("/plan", json={"release": {"kind": "target", "position": TARGET_M}}).json()
    assert (before["profile"], before["hit_probability"]["profile"]) == (None, None)
    arguments = ["calibrate", "landings", "--cell", "ur5e-sim", "--adopt", "--json", "--url", str(up.http.base_url)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    learnt = json.loads(result.stdout)
    assert learnt["adopted"] and learnt["evidence"]["throws"]
    assert learnt["lag_s"] + learnt["delay_s"] == pytest.approx(0.060, abs=0.010)
    refused = up.http.post("/execute", json={"plan_id": before["id"]})
    assert (refused.status_code, refused.json()["type"]) == (409, "/problems/plan-not-executable")
    plan = up.http.post("/plan", json={"release": {"kind": "target", "position": TARGET_M}}).json()
    assert plan["profile"] == plan["hit_probability"]["profile"] == learnt["profile"]
    assert plan["hit_probability"]["value"] > before["hit_probability"]["value"]
    run = executed(up.http, plan["id"])
    assert run["outcome"] in ("completed", "late"), run["reason"]
    assert up.http.post("/cells/ur5e-sim/profiles/revert").json()["profile"] is None


def test_ctrl_c_leaves_no_orphans(up: Up):
    assert up.down() == 0
    gone, alive = psutil.wait_procs(up.children, DOWN_WITHIN_S)
    assert len(gone) >= 3
    assert alive == []
