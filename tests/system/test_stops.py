"""An operator's stop, while the database does not answer: over HTTP, on the command line, by SIGTERM."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.system.rig import ABORTED_S, FAST_RAD_S, RESTED_S, ROOT, Rig
from tests.system.service import RigService

NOBODY = "http://127.0.0.1:1"  # where no service listens


@contextlib.contextmanager
def locked(rig: Rig) -> Iterator[None]:
    """Locks the database, so that every writer waits."""
    with contextlib.closing(sqlite3.connect(rig.url.removeprefix("sqlite:///"))) as other:
        other.execute("BEGIN EXCLUSIVE")
        yield
        other.rollback()


def ends_aborted(rig: Rig, at: float, released: int) -> None:
    """The arm comes to rest as after any abort, while the database is locked, and keeps the object."""
    assert rig.rest_time(at) < ABORTED_S
    assert len(rig.world()["releases"]) == released
    assert rig.state()["gripper_holds"] is not None


@pytest.mark.parametrize("name", ["id", pytest.param("latest", marks=pytest.mark.slow)])
def test_over_http_with_a_locked_database(rig: Rig, name: str) -> None:
    with RigService(rig) as service:
        id = rig.launch(FAST_RAD_S)
        released = len(rig.world()["releases"])
        with locked(rig):
            at = rig.state()["t"]
            response = service.http.post(f"/executions/{id if name == 'id' else name}/abort")
            assert response.status_code == 202, response.text
            assert response.json()["id"] == id
            ends_aborted(rig, at, released)
        row = rig.end(id)
        assert row.outcome == "aborted", row.reason
        assert not rig.is_latched()


@pytest.mark.slow
def test_on_the_command_line_without_a_service(rig: Rig) -> None:
    script = "import sys; from api.cli import main; import api.cli.throw; print(flush=True); input(); main()"
    command = [sys.executable, "-c", script, "abort", "--url", NOBODY]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, env=rig.environment, stdin=pipe, stdout=pipe, text=True) as line:
        assert line.stdout is not None
        line.stdout.readline()  # it is loaded, and waits for the word
        id = rig.far_from_its_start()  # a command takes longer to begin than a launch lasts
        with locked(rig):
            said, _ = line.communicate("\n")
            assert line.returncode == 0
            assert said == f"{id}: the executor was asked to brake\n"
            rig.until(lambda: (state := rig.state())["t"] - state["moved_at"] > RESTED_S)
    row = rig.end(id)
    assert row.outcome == "aborted", row.reason
    assert not rig.is_latched()


@pytest.mark.slow
def test_by_sigterm_with_a_locked_database(rig: Rig) -> None:
    id = rig.launch(0.1)
    released = len(rig.world()["releases"])
    with locked(rig):  # the executor's telemetry waits for it from now on
        rig.until(lambda: max(map(abs, rig.state()["qd"])) > FAST_RAD_S, period=0.001)
        at = rig.state()["t"]
        os.kill(rig.executor.pid, signal.SIGTERM)
        ends_aborted(rig, at, released)
    rig.executor.wait(60.0)
    rig.start_executor()
    row = rig.end(id)
    assert row.outcome == "aborted", row.reason
    assert "asked to end" in row.reason
