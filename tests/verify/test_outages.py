"""Ends and outages under load: what was answered is there, every client has a problem document, the log says why once.

Planner processes, service and database are real; the executor's own kills are in `tests/system/test_kills.py`.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx2
import psutil
import psycopg
import pytest

from store import Store
from tests.processes import children_with
from tests.system.rig import RESTED_S, Rig
from tests.system.service import RigService
from tests.verify.conftest import ServiceProcess, server_program

pytestmark = pytest.mark.slow
LOAD_S = 4.0  # [s] of planning before and after each blow
CLIENTS = 4
JOINT = {
    "release": {
        "kind": "joint",
        "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
        "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
    },
    "backend": "ruckig",
}
SLOW = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
UNAVAILABLE = {"not-ready", "solver-failed", "overloaded"}


class Load:
    """Clients that plan without a pause, and what they were answered."""

    def __init__(self, service: ServiceProcess) -> None:
        self.service, self.ended = service, threading.Event()
        self.planned: list[str] = []
        self.problems: Counter[str] = Counter()
        self.cut = 0
        self.strange: list[str] = []
        self.threads = [threading.Thread(target=self._go_on) for _ in range(CLIENTS)]

    def __enter__(self) -> Load:
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        for thread in self.threads:
            thread.join()

    def _go_on(self) -> None:
        while not self.ended.is_set():
            try:
                response = self.service.plan(JOINT)
            except httpx2.TransportError:
                self.cut += 1
                time.sleep(0.1)
                continue
            if response.status_code == 201:
                self.planned.append(response.json()["id"])
            elif response.headers["content-type"] == "application/problem+json":
                self.problems[response.json()["type"].rsplit("/", 1)[1]] += 1
                time.sleep(0.1)
            else:
                self.strange.append(response.text)

    def all_present(self, url: str) -> bool:
        """Returns whether every plan that was answered is in the store."""
        store = Store.open(url)
        try:
            return all(store.plan(id) is not None for id in self.planned)
        finally:
            store.close()


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'fling.db'}"


@pytest.fixture
def service(sqlite_url: str, tmp_path: Path) -> Iterator[ServiceProcess]:
    running = ServiceProcess(sqlite_url, tmp_path / "service.log")
    yield running
    running.stop()


def test_sigterm_with_slow_plans_in_line(sqlite_url: str, tmp_path: Path):
    service = ServiceProcess(sqlite_url, tmp_path / "service.log", workers=1)
    answers: list[httpx2.Response] = []
    clients = [threading.Thread(target=lambda: answers.append(service.plan(SLOW))) for _ in range(5)]
    for client in clients:
        client.start()
    service.until(lambda: "fling_plans_waiting 5.0" in service.get("/metrics").text)
    service.process.send_signal(signal.SIGTERM)
    for client in clients:
        client.join()
    assert service.process.wait(60.0) == 0
    statuses = Counter(answer.status_code for answer in answers)
    assert statuses.keys() <= {201, 503}
    assert statuses[201] >= 1
    assert statuses[503] >= 1
    store = Store.open(sqlite_url)
    for answer in answers:
        if answer.status_code == 201:
            assert store.plan(answer.json()["id"]) is not None
        else:
            assert answer.json()["type"] == "/problems/shutting-down"
            assert int(answer.headers["retry-after"]) > 0
    store.close()


def test_a_killed_service_has_stored_what_it_answered(service: ServiceProcess, sqlite_url: str):
    with Load(service) as load:
        time.sleep(LOAD_S)
        children = psutil.Process(service.process.pid).children(recursive=True)
        service.process.kill()
        service.process.wait()
    assert psutil.wait_procs(children, 20.0)[1] == []
    assert load.strange == []
    assert load.planned
    service.start()
    assert all(service.get(f"/plans/{id}?trajectory=false").status_code == 200 for id in load.planned)


def test_a_killed_planner_process_costs_no_answer(service: ServiceProcess, sqlite_url: str):
    with Load(service) as load:
        time.sleep(LOAD_S / 2)
        before = len(load.planned)
        workers = children_with("spawn_main", service.process.pid)
        workers[0].kill()
        service.until(lambda: len(load.planned) > before + 5)
    assert (load.strange, load.cut) == ([], 0)
    assert set(load.problems) <= {"solver-failed"}
    assert load.all_present(sqlite_url)


def test_a_full_disk_is_named_and_logged_once(service: ServiceProcess, sqlite_url: str):
    before, hard = resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE)
    with Load(service) as load:
        time.sleep(LOAD_S / 2)
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (1000, hard))
        service.until(lambda: service.get("/readyz").status_code == 503)
        assert service.get("/readyz").json()["outage"] == "disk_full"
        time.sleep(LOAD_S / 2)
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (before, hard))
        service.until(lambda: service.get("/readyz").status_code == 200)
        time.sleep(LOAD_S / 2)
    assert (load.strange, load.cut) == ([], 0)
    assert set(load.problems) <= UNAVAILABLE
    assert load.problems["not-ready"] > 0
    assert load.all_present(sqlite_url)
    assert len(service.lines(level="error", outage="disk_full")) == 1
    assert len(service.lines(level="warning", outage="disk_full")) == 1


def test_a_locked_database_is_named_and_logged_once(service: ServiceProcess, sqlite_url: str):
    with Load(service) as load:
        time.sleep(LOAD_S / 2)
        other = sqlite3.connect(sqlite_url.removeprefix("sqlite:///"), isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        service.until(lambda: service.get("/readyz").status_code == 503)
        assert service.get("/readyz").json()["outage"] == "locked"
        assert service.get("/healthz").status_code == 200
        service.until(lambda: load.problems["not-ready"] > 0)
        other.execute("ROLLBACK")
        other.close()
        service.until(lambda: service.get("/readyz").status_code == 200)
        time.sleep(LOAD_S / 2)
    assert (load.strange, load.cut) == ([], 0)
    assert set(load.problems) <= UNAVAILABLE
    assert load.all_present(sqlite_url)
    assert len(service.lines(level="error", outage="locked")) == 1


class PostgresServer:
    """A PostgreSQL server that can be killed and started again. One refuses to run as root: it is nobody's then."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.user = folder, "nobody" if os.geteuid() == 0 else None
        if self.user:
            shutil.chown(folder, self.user)
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        initdb = [str(server_program("initdb")), "-D", str(folder / "data"), "-U", "postgres", "--auth=trust"]
        subprocess.run(initdb, check=True, stdout=subprocess.DEVNULL, cwd=folder, user=self.user)
        self.url = f"postgresql+psycopg://postgres@127.0.0.1:{self.port}/postgres"
        self.start()

    def start(self) -> None:
        flags = [f"port={self.port}", "listen_addresses=127.0.0.1", f"unix_socket_directories={self.folder}"]
        options = [part for flag in flags for part in ("-c", flag)]
        command = [str(server_program("postgres")), "-D", str(self.folder / "data"), *options]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, cwd=self.folder, user=self.user, **quiet)
        ServiceProcess.until(self._answers)

    def kill(self) -> None:
        """Kills the server and its processes at once, as a power cut does."""
        self.send(signal.SIGKILL)
        self.process.wait()

    def send(self, number: signal.Signals) -> None:
        """Sends a signal to the server and its processes."""
        everyone = [psutil.Process(self.process.pid), *psutil.Process(self.process.pid).children(recursive=True)]
        for process in everyone:
            process.send_signal(number)

    def _answers(self) -> bool:
        try:
            psycopg.connect(self.url.replace("+psycopg", "")).close()
        except psycopg.OperationalError:
            return False
        return True


@pytest.fixture
def postgres() -> Iterator[PostgresServer]:
    folder = Path(tempfile.mkdtemp(prefix="fling-pg-"))
    server = PostgresServer(folder)
    yield server
    server.process.terminate()
    server.process.wait(30.0)
    shutil.rmtree(folder, ignore_errors=True)


def test_a_killed_postgresql_loses_nothing_that_was_answered(postgres: PostgresServer, tmp_path: Path):
    Store.upgrade(postgres.url)
    service = ServiceProcess(postgres.url, tmp_path / "service.log")
    try:
        with Load(service) as load:
            time.sleep(LOAD_S)
            postgres.kill()
            service.until(lambda: service.get("/readyz").status_code == 503)
            assert service.get("/readyz").json()["outage"] == "unreachable"
            time.sleep(1.0)
            before = len(load.planned)
            postgres.start()
            service.until(lambda: len(load.planned) > before + 5)
        assert (load.strange, load.cut) == ([], 0)
        assert set(load.problems) <= UNAVAILABLE
        assert load.all_present(postgres.url)
        assert len(service.lines(level="error", outage="unreachable")) == 1
    finally:
        service.stop()


@pytest.mark.parametrize("is_killed", [True, False], ids=["killed", "frozen"])
def test_a_stop_reaches_the_executor_without_postgresql(postgres: PostgresServer, tmp_path: Path, is_killed: bool):
    """A server that died refuses connections; a frozen one takes them, and never answers."""
    Store.upgrade(postgres.url)
    rig = Rig(tmp_path, url=postgres.url)
    try:
        rig.start()
        with RigService(rig) as service:
            id = rig.far_from_its_start()
            postgres.kill() if is_killed else postgres.send(signal.SIGSTOP)
            try:
                response = service.http.post(f"/executions/{id}/abort")
                rig.until(lambda: (state := rig.state())["t"] - state["moved_at"] > RESTED_S)
            finally:
                postgres.start() if is_killed else postgres.send(signal.SIGCONT)
            assert response.status_code == 202, response.text
            row = rig.end(id)
            assert row.outcome == "aborted", row.reason
    finally:
        rig.stop()
