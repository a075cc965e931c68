"""A service in this process, its planner in one of its own; an executor played by the test."""

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

ROOT = Path(__file__).parents[2]
JOINT = {
    "kind": "joint",
    "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
    "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
}
REQUEST: dict[str, Any] = {"release": JOINT, "backend": "ruckig"}
READY_S = 60.0


@dataclass
class Running:
    """A service, its client and its store."""

    client: TestClient
    store: Store
    settings: ServiceSettings

    def plan(self, **changes: Any) -> dict[str, Any]:
        response = self.client.post("/plan", json={**REQUEST, **changes})
        assert response.status_code == 201, response.text
        return response.json()


@contextmanager
def running(settings: ServiceSettings) -> Iterator[Running]:
    app = create_app(settings)
    with TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False) as client:
        yield Running(client, app.state.service.store, settings)


def wait_until_ready(service: Running) -> None:
    deadline = time.monotonic() + READY_S
    while service.client.get("/readyz").status_code != 200:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture(scope="session")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of cells of the tests' own: one simulated, one changed by a test, one real, one wrong."""
    folder = tmp_path_factory.mktemp("cells")
    text = (ROOT / "cells" / "ur5e-sim.toml").read_text()
    (folder / "ur5e-sim.toml").write_text(text)
    (folder / "changing.toml").write_text(text)
    (folder / "real.toml").write_text(text.replace('kind = "sim"', 'kind = "ur"'))
    (folder / "wrong.toml").write_text(text + "\nunknown_key = 1\n")
    return folder


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory, cells: Path) -> Iterator[Running]:
    """One service for every test that neither needs its own settings nor a broken planner."""
    url = f"sqlite:///{tmp_path_factory.mktemp('data') / 'fling.db'}"
    with running(ServiceSettings(database_url=url, cells=cells, planner_workers=1)) as service:
        wait_until_ready(service)
        yield service


@pytest.fixture
def service(shared: Running) -> Iterator[Running]:
    """The shared service, with no execution left open afterwards."""
    yield shared
    for row in shared.store.cell_statuses():
        shared.store.close_open_executions(row.cell)


@pytest.fixture(scope="session")
def plan(shared: Running) -> dict[str, Any]:
    """One plan for the simulated cell."""
    return shared.plan()


class PlayedExecutor:
    """An executor without a robot: beats, and does what the test says."""

    def __init__(self, store: Store, cell: str = "ur5e-sim") -> None:
        self.store, self.cell = store, cell
        self.robot: dict[str, Any] = {"positions": [0.1, -1.5, 1.5, -1.5, -1.5, 0.0]}
        self.fault: dict[str, Any] | None = None
        self.read_only = False
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)

    def beat(self) -> None:
        self.store.beat(self.cell, "played", "sim", self.robot, self.fault, self.read_only)

    def start(self) -> PlayedExecutor:
        self.beat()
        self._thread.start()
        return self

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        self.store.beat(self.cell, "played", "sim", {}, None, False)

    def _go_on(self) -> None:
        while not self._ended.wait(0.3):
            self.beat()


@pytest.fixture
def executor(service: Running) -> Iterator[PlayedExecutor]:
    played = PlayedExecutor(service.store).start()
    yield played
    played.stop()
