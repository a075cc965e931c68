"""The wheel in clean environments: plan, serve and throw from a folder that has its own `planner/ store/ api/`."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tarfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.verify.conftest import READY_S

pytestmark = pytest.mark.slow
TRAPS = ("fling", "planner", "store", "learning", "jobs", "api", "executor", "simulator", "numpy", "json")
REQUEST = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
HOST = "127.0.45.2"
TRIES = 3  # on an overloaded machine the outcome may be `late`


class CleanInstall:
    """An environment with an archive of Fling and its pinned requirements alone, used from a hostile folder."""

    def __init__(self, folder: Path, python: str, requirements: Path, archive: Path) -> None:
        self.bin = folder / "venv" / "bin"
        self.folder = folder
        self._run([python, "-m", "venv", str(folder / "venv")])
        pip = [str(self.bin / "python"), "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--quiet"]
        self._run([*pip, "--require-hashes", "-r", str(requirements)])
        self._run([*pip, "--no-deps", "--no-build-isolation", str(archive)])
        self.work = folder / "work"
        for name in TRAPS:
            (self.work / name).mkdir(parents=True)
            (self.work / name / "__init__.py").write_text(f"raise SystemExit('{name} of the current folder')\n")
        (self.work / "request.json").write_text(json.dumps(REQUEST))
        data = folder / "data"
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith(("FLING_", "PYTHON"))},
            "FLING_DATABASE_URL": f"sqlite:///{folder / 'fling.db'}", "FLING_DATA": str(data),
            "FLING_PLANNER_WORKERS": "1",
        }  # fmt: skip

    def fling(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Runs a command in the hostile folder."""
        return subprocess.run(
            [str(self.bin / "fling"), *arguments],
            cwd=self.work, env=self.environment, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def own_cell(self) -> None:
        """Gives this environment a copy of the shipped cell, on an address of its own."""
        shipped = next(self.folder.glob("venv/lib/*/site-packages/fling/cells/ur5e-sim.toml"))
        cells = self.folder / "cells"
        cells.mkdir()
        (cells / shipped.name).write_text(re.sub(r'host = "127[^"]*"', f'host = "{HOST}"', shipped.read_text()))
        self.environment["FLING_CELLS"] = str(cells)

    def _run(self, command: list[str]) -> None:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory, root: Path, wheel: Path) -> CleanInstall:
    folder = tmp_path_factory.mktemp("clean")
    return CleanInstall(folder, sys.executable, root / "requirements" / "run.txt", wheel)


def plan_of(done: subprocess.CompletedProcess[str]) -> dict:
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def test_plan_and_report_from_a_hostile_folder(installed: CleanInstall):
    plan = plan_of(installed.fling("plan", "request.json"))
    assert plan["certificate"]["valid"] is True
    assert plan["flight"]["landing_point"] == pytest.approx([1.2, 0.3, 0.0], abs=0.011)
    (installed.work / "plan.json").write_text(json.dumps(plan))
    assert installed.fling("report", "plan.json").returncode == 0
    assert installed.fling("version").stdout.startswith("fling 0.")


def test_the_library_from_a_folder_of_its_own(installed: CleanInstall):
    script = (
        "import fling; a = fling.plan({'release': {'kind': 'target', 'position': [1.2, 0.3, 0.0]}}); print(len("
        "fling.as_joint_trajectory(a)['points']), a.certificate.valid, 'ur5e-sim' in fling.cell_names())"
    )
    done = subprocess.run([str(installed.bin / "python"), "-P", "-c", script], cwd=installed.work,
                          env=installed.environment, capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[1:] == ["True", "True"]


def test_it_plans_where_there_is_no_compiler(installed: CleanInstall, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(installed.environment, "PATH", str(installed.folder / "nothing"))
    plan_of(installed.fling("plan", "request.json"))


@pytest.fixture
def up(installed: CleanInstall) -> Iterator[str]:
    """`fling up` from the hostile folder; yields the URL."""
    installed.own_cell()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    log = installed.folder / "up.log"
    with log.open("w") as output:
        command = [str(installed.bin / "fling"), "up", "--port", str(port), "--patience", str(READY_S)]
        process = subprocess.Popen(command, cwd=installed.work, env=installed.environment, stdout=output, stderr=output)
    try:
        deadline = time.monotonic() + READY_S
        while "Fling is up" not in log.read_text():
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.2)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)


def test_serve_and_throw_from_a_hostile_folder(installed: CleanInstall, up: str):
    if sys.version_info >= (3, 13):
        pytest.skip("ur_rtde has no wheels for this Python")
    for _ in range(TRIES):
        done = installed.fling("throw", "1.2", "0.3", "0.0", "--url", up, "--json")
        if done.returncode == 0:
            break
        installed.fling("acknowledge", "--url", up)
    assert done.returncode == 0, done.stdout + done.stderr
    execution = json.loads(done.stdout)
    assert execution["outcome"] == "completed"
    assert execution["metrics"]["landing_error_m"] < 0.01


def test_the_source_archive_builds_installs_and_throws(tmp_path: Path, source_archive: Path):
    """With the requirements that it brings along, from the folder of another project."""
    with tarfile.open(source_archive) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    found = CleanInstall(tmp_path, sys.executable, source / "requirements" / "run.txt", source_archive)
    assert plan_of(found.fling("plan", "request.json"))["certificate"]["valid"] is True
    if sys.version_info >= (3, 13):
        pytest.skip("ur_rtde has no wheels for this Python")
    found.own_cell()
    for _ in range(TRIES):
        done = found.fling("demo")
        if done.returncode == 0:
            break
    assert done.returncode == 0, done.stdout + done.stderr


def interpreter(version: str) -> str | None:
    """Returns a Python of this version that can make environments, None where there is none."""
    kept = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    for python in filter(None, (shutil.which(f"python{version}"), *map(str, kept))):
        if subprocess.run([python, "-c", "import venv, ensurepip"], capture_output=True, check=False).returncode == 0:
            return python
    return None


@pytest.mark.parametrize("version", ["3.12", "3.13"])
def test_planning_on_other_interpreters(version: str, tmp_path: Path, root: Path, wheel: Path):
    python = interpreter(version)
    if python is None:
        pytest.skip(f"there is no Python {version} on this machine")
    other = CleanInstall(tmp_path, python, root / "requirements" / "run.txt", wheel)
    plan = plan_of(other.fling("plan", "request.json"))
    assert plan["certificate"]["valid"] is True
    client = [str(other.bin / "python"), "-P", "-c", "import rtde_control"]
    streams = subprocess.run(client, capture_output=True, check=False)
    assert (streams.returncode == 0) == (version < "3.13")
