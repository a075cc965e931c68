"""A service in this process with its planner process, and an executor simulated by the test."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.settings import ServiceSettings
from store import Store
from tests.postgres import POSTGRES, database_on

ROOT = Path(__file__).parents[2]
JOINT = {
    "kind": "joint",
    "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
    "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
}
REQUEST: dict[str, Any] = {"release": JOINT, "backend": "ruckig"}
READY_S = 180.0  # [s] the workers load their solvers first, on a busy machine beside eight others
NO_ID = "00000000-0000-7000-8000-000000000000"  # of nothing


@dataclass
class RunningService:
    """A service, its client and its store."""

    client: TestClient
    store: Store
    settings: ServiceSettings

    def plan(self, **changes: Any) -> dict[str, Any]:
        response = self.client.post("/plan", json={**REQUEST, **changes})
        assert response.status_code == 201, response.text
        return response.json()


@contextmanager
def running(settings: ServiceSettings) -> Iterator[RunningService]:
    app = create_app(settings)
    with TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False) as client:
        yield RunningService(client, app.state.service.store, settings)


def wait_until_ready(service: RunningService) -> None:
    deadline = time.monotonic() + READY_S
    while service.client.get("/readyz").status_code != 200:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture(scope="session")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder of cells: one simulated, one changed by a test, one real, one invalid."""
    folder = tmp_path_factory.mktemp("cells")
    text = (ROOT / "cells" / "ur5e-sim.toml").read_text()
    (folder / "ur5e-sim.toml").write_text(text)
    (folder / "changing.toml").write_text(text)
    (folder / "real.toml").write_text(text.replace('kind = "sim"', 'kind = "ur"'))
    (folder / "wrong.toml").write_text(text + "\nunknown_key = 1\n")
    return folder


@pytest.fixture(scope="session")
def database_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Yields the URL of the shared service's database: SQLite, or PostgreSQL if FLING_TEST_POSTGRES names a server."""
    if POSTGRES is None:
        yield f"sqlite:///{tmp_path_factory.mktemp('data') / 'fling.db'}"
        return
    with database_on(POSTGRES) as url:
        Store.upgrade(url)
        yield url


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder in which the shared service looks for executors of this machine."""
    return tmp_path_factory.mktemp("executors")


@pytest.fixture(scope="session")
def shared(database_url: str, cells: Path, data: Path) -> Iterator[RunningService]:
    """Yields one service for every test that needs no settings of its own."""
    with running(ServiceSettings(database_url=database_url, cells=cells, data=data, planner_workers=1)) as service:
        wait_until_ready(service)
        yield service


@pytest.fixture
def service(shared: RunningService) -> Iterator[RunningService]:
    """Yields the shared service; closes its open executions, batches and jobs afterwards."""
    yield shared
    for job in shared.store.unfinished_jobs():
        shared.store.cancel_job(job.id)
    for batch in shared.store.unfinished_batches("service"):
        shared.store.cancel_batch(batch.id)
    for row in shared.store.cell_statuses():
        shared.store.close_open_executions(row.cell)


@pytest.fixture(scope="session")
def plan(shared: RunningService) -> dict[str, Any]:
    """Returns one plan for the simulated cell."""
    return shared.plan()


def beat_as(store: Store, executor_id: str, cell: str = "ur5e-sim", link_kind: str = "sim", *status: Any) -> None:
    """Sends a heartbeat of an executor, which takes the cell first."""
    store.take_cell(cell, executor_id, link_kind, "a test", store.cell_status(cell))
    assert store.record_heartbeat(cell, executor_id, link_kind, *status)


class FakeExecutor:
    """An executor without a robot: sends heartbeats with the state that the test sets."""

    def __init__(self, store: Store, cell: str = "ur5e-sim") -> None:
        self.store = store
        self.cell = cell
        self.robot: dict[str, Any] = {"positions": [0.1, -1.5, 1.5, -1.5, -1.5, 0.0]}
        self.fault: dict[str, Any] | None = None
        self.read_only = False
        self._ended = threading.Event()
        self._beats = threading.Lock()  # a beat with an older state must not be stored after one with a newer
        self._thread = threading.Thread(target=self._go_on, daemon=True)

    def beat(self) -> None:
        with self._beats:
            beat_as(self.store, "fake", self.cell, "sim", self.robot, self.fault, self.read_only)

    def start(self) -> FakeExecutor:
        self.beat()
        self._thread.start()
        return self

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        beat_as(self.store, "fake", self.cell, "sim", {}, None, False)

    def _go_on(self) -> None:
        while not self._ended.wait(0.3):
            self.beat()


@pytest.fixture
def executor(service: RunningService) -> Iterator[FakeExecutor]:
    fake = FakeExecutor(service.store).start()
    yield fake
    fake.stop()
