"""What long tests share: a wheel built from the files under version control, a PostgreSQL server, a service."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import psycopg
import pytest

HOST = "127.0.45.4"  # of the simulated controller beside which examples run
ROOT = Path(__file__).parents[2]
READY_S = 600.0  # [s] planner processes of lowest priority load and warm up on a busy machine
LONG_S = 1200  # [s] for one test of this folder
WITHOUT_POSTGRES = "FLING_WITHOUT_POSTGRES" in os.environ  # a machine where no server can be installed
SERVER_FOLDERS = Path("/usr/lib/postgresql")  # where Debian keeps servers, a folder a version


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Gives the tests of this folder more time than the others have."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(LONG_S))


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A copy of the files under version control, as a new user clones them."""
    root = request.config.rootpath
    folder = tmp_path_factory.mktemp("clone") / "fling"
    names = subprocess.run(["git", "ls-files", "-z"], cwd=root, check=True, capture_output=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name)
    return folder


@pytest.fixture(scope="session")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the copy."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(checkout)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="session")
def source_archive(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source archive, built from the copy."""
    folder = tmp_path_factory.mktemp("source")
    command = [sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", str(folder), str(checkout)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(folder.glob("*.tar.gz"))


def server_program(name: str) -> str | None:
    """Returns the path of a program of PostgreSQL's server, None where there is none."""
    installed = sorted(SERVER_FOLDERS.glob(f"*/bin/{name}"), key=lambda path: float(path.parts[-3]))
    return shutil.which(name) or (str(installed[-1]) if installed else None)


@pytest.fixture(scope="session")
def postgres_url() -> Iterator[str]:
    """URL of an empty PostgreSQL server of these tests' own. One refuses to run as root: it is nobody's then."""
    initdb = server_program("initdb")
    server = server_program("postgres")
    if initdb is None or server is None:
        if WITHOUT_POSTGRES:
            pytest.skip("POSTGRESQL IS MISSING: nothing is verified on it")
        pytest.fail("there is no PostgreSQL server here: apt-get install postgresql")
    user = "nobody" if os.geteuid() == 0 else None
    folder = Path(tempfile.mkdtemp(prefix="fling-pg-"))
    if user:
        shutil.chown(folder, user)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    data = str(folder / "data")
    options = {"cwd": folder, "user": user, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([initdb, "-D", data, "-U", "postgres", "--auth=trust", "--no-sync"], check=True, **options)
    flags = ["-c", f"port={port}", "-c", "listen_addresses=127.0.0.1", "-c", f"unix_socket_directories={folder}"]
    process = subprocess.Popen([server, "-D", data, "-F", *flags], **options)
    try:
        _wait_until_listening(process, port)
        yield f"postgresql+psycopg://postgres@127.0.0.1:{port}/postgres"
    finally:
        process.terminate()
        process.wait(30)
        shutil.rmtree(folder, ignore_errors=True)


def _wait_until_listening(process: subprocess.Popen[bytes], port: int) -> None:
    deadline = time.monotonic() + 60.0
    while True:
        assert process.poll() is None, "the PostgreSQL server ended"
        try:
            psycopg.connect(f"postgresql://postgres@127.0.0.1:{port}/postgres").close()
            return
        except psycopg.OperationalError:
            assert time.monotonic() < deadline, "the PostgreSQL server does not answer"
            time.sleep(0.1)


class ServiceProcess:
    """A service process on an address of its own, with its log."""

    def __init__(self, url: str, log: Path, workers: int = 2, **settings: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.address = f"http://127.0.0.1:{self.port}"
        self.url = url
        self.log = log
        self.workers = workers
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Starts the process and waits until it is ready."""
        own = {"FLING_DATABASE_URL": self.url, "FLING_PORT": str(self.port), "FLING_CELLS": str(ROOT / "cells")}
        own |= {"FLING_PLANNER_WORKERS": str(self.workers), **self.settings}
        command = [sys.executable, "-m", "api"]
        self.process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, **own}, stderr=subprocess.PIPE)
        threading.Thread(target=self._keep_log, args=(self.process,), daemon=True).start()
        self.until(self._is_ready)

    def _is_ready(self) -> bool:
        assert self.process.poll() is None, self.log.read_text()
        return self.get("/readyz").status_code == 200

    def _keep_log(self, process: subprocess.Popen[bytes]) -> None:
        """Writes the log from outside: limits of the service's files leave it alone."""
        assert process.stderr is not None
        with self.log.open("ab", buffering=0) as log, process.stderr as stream:
            for line in stream:
                log.write(line)

    def stop(self) -> None:
        """Ends the process."""
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait(150.0)

    def get(self, path: str) -> httpx2.Response:
        return httpx2.get(f"{self.address}{path}", timeout=30.0)

    def plan(self, request: dict[str, Any]) -> httpx2.Response:
        return httpx2.post(f"{self.address}/plan?trajectory=false", json=request, timeout=180.0)

    def lines(self, **fields: str) -> list[dict[str, Any]]:
        """Returns the lines of the log with these members."""
        found = [json.loads(line) for line in self.log.read_text().splitlines() if line.startswith("{")]
        return [line for line in found if line.items() >= fields.items()]

    @staticmethod
    def until(condition: Callable[[], bool], within_s: float = READY_S) -> None:
        """Waits for a condition; a service that does not answer meets none."""
        deadline = time.monotonic() + within_s
        while True:
            try:
                if condition():
                    return
            except httpx2.TransportError:
                pass
            assert time.monotonic() < deadline, "waited too long"
            time.sleep(0.1)


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Path:
    """A folder as a user's: cells, and what the examples write."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(root / "cells", folder / "cells")
    cell = folder / "cells" / "ur5e-sim.toml"
    cell.write_text(re.sub(r'host = "127[^"]*"', f'host = "{HOST}"', cell.read_text()))
    (folder / "request.json").write_text('{"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}')
    (folder / "corners.txt").write_text("1.2 0.3 0.0\n")
    return folder


@pytest.fixture(scope="session")
def environment(place: Path) -> Iterator[dict[str, str]]:
    """The environment of a user beside a running `fling up`."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    found = {
        **os.environ, "FLING_DATABASE_URL": f"sqlite:///{place / 'fling.db'}", "FLING_DATA": str(place),
        "FLING_PLANNER_WORKERS": "1", "FLING_PORT": str(port), "FLING_URL": f"http://127.0.0.1:{port}",
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }  # fmt: skip
    log = place / "up.log"
    with log.open("w") as output:
        command = ["fling", "up", "--patience", str(READY_S)]
        process = subprocess.Popen(command, cwd=place, env=found, stdout=output, stderr=output)
    try:
        deadline = time.monotonic() + READY_S
        while "Fling is up" not in log.read_text():
            assert process.poll() is None and time.monotonic() < deadline, log.read_text()
            time.sleep(0.2)
        yield found
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)
