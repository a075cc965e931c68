"""The page in Chromium on a service in this process, whose executor is the test: no controller, no real time."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import uvicorn
from playwright.sync_api import Browser, Playwright, expect, sync_playwright

from api.app import create_app
from api.settings import ServiceSettings
from store import Store
from tests.api.conftest import JOINT, ROOT, FakeExecutor
from tests.system.browser import PLAN_MS, Visit, launch, visit

expect.set_options(timeout=15_000)  # [ms] five seconds are short for a busy machine

READY_S = 180.0  # [s] a planner process starts, on a busy machine
CELL = "ur5e-sim"
HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
METRICS: dict[str, Any] = {"released": True, "missed_ticks": 0, "landing_error_m": 4e-3, "tracking_error_max_rad": 2e-3}


@dataclass
class Desk:
    """A service with its store, and the executor that the test plays.

    Attributes:
        url: of the page.
        store: what the executor writes to.
        executor: its heartbeats; robot, fault and `read_only` are the test's to set.
    """

    url: str
    store: Store
    executor: FakeExecutor

    def execution(self, plan_id: str, outcome: str = "completed", **fields: Any) -> str:
        """Adds a finished execution of a plan; returns its id."""
        reason = fields.pop("reason", None)
        metrics = fields.pop("metrics", METRICS)
        row = self.store.queue_execution(plan_id, CELL, **fields)
        self.store.claim_execution(CELL, "fake")
        self.store.finish_execution(row.id, outcome, reason, metrics)
        return row.id

    def begun(self, plan_id: str, state: str = "approaching") -> str:
        """Adds an execution that runs; returns its id."""
        row = self.store.queue_execution(plan_id, CELL)
        self.store.claim_execution(CELL, "fake")
        self.store.set_state(row.id, state)
        return row.id


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """One service for all tests of a module: what one module leaves behind, no other counts."""
    folder = tmp_path_factory.mktemp("desk")
    cells = folder / "cells"
    cells.mkdir()
    text = (ROOT / "cells" / f"{CELL}.toml").read_text()
    (cells / f"{CELL}.toml").write_text(text)
    (cells / "real.toml").write_text(text.replace('kind = "sim"', 'kind = "ur"'))
    (cells / "far-away.toml").write_text(text.replace('host = "127.0.0.1"', 'host = "8.8.8.8"'))
    database = f"sqlite:///{folder / 'fling.db'}"
    app = create_app(ServiceSettings(database_url=database, cells=cells, planner_workers=1, tokens_file=None))
    server = uvicorn.Server(
        uvicorn.Config(app, host="127.0.0.1", port=0, log_level="warning", timeout_graceful_shutdown=1)
    )
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    deadline = time.monotonic() + READY_S
    while not server.started:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    port = server.servers[0].sockets[0].getsockname()[1]
    store = app.state.service.store
    yield Desk(f"http://127.0.0.1:{port}", store, FakeExecutor(store))
    server.should_exit = True
    thread.join(20.0)


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def drawing_browser(playwright: Playwright) -> Iterator[Browser]:
    """Chromium with WebGL, for what the scene shows."""
    started = launch(playwright)
    yield started
    started.close()


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    """Chromium without WebGL: quick."""
    started = launch(playwright, draws=False)
    yield started
    started.close()


@pytest.fixture
def desk(served: Desk) -> Iterator[Desk]:
    """The service with an executor in order; what runs is closed afterwards."""
    executor = FakeExecutor(served.store)
    executor.robot = {"positions": HOME, "connected": True, "refusals": [], "warnings": []}
    yield Desk(served.url, served.store, executor.start())
    executor.stop()
    served.store.close_open_executions(CELL)


@pytest.fixture
def viewer(desk: Desk, drawing_browser: Browser) -> Iterator[Visit]:
    """A fresh tab with a scene."""
    with visit(drawing_browser, desk.url) as opened:
        opened.region("Robots").get_by_text("Ready").wait_for()
        yield opened


@pytest.fixture
def guest(desk: Desk, browser: Browser) -> Iterator[Visit]:
    """A fresh tab."""
    with visit(browser, desk.url) as opened:
        opened.region("Robots").get_by_text("Ready").wait_for()
        yield opened


@pytest.fixture(scope="module")
def plan_id(served: Desk) -> str:
    """Id of a plan that throws at no target: quick to make."""
    return posted(served, {"release": JOINT, "backend": "ruckig"})


@pytest.fixture(scope="module")
def thrown_id(served: Desk) -> str:
    """Id of a plan that throws at a target on the floor."""
    release = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    return posted(served, {"release": release, "backend": "ruckig", "release_window_s": 0.0})


def planned(guest: Visit, x: str = "1.2", z: str = "0") -> None:
    """Plans a throw for a release on time: the quickest that hits a target."""
    guest.field("x [m]").fill(x)
    guest.field("z [m]").fill(z)
    options = guest.page.locator("form details.options").first
    options.evaluate("(element) => (element.open = true)")
    guest.field("Release window ± [s]").fill("0")
    guest.page.get_by_label("Back end").select_option("ruckig")
    guest.button("Plan").click()
    guest.page.locator(".summary.valid").wait_for(timeout=PLAN_MS)


def posted(desk: Desk, request: dict[str, Any]) -> str:
    """Plans a request; returns the plan's id."""
    import httpx2

    with httpx2.Client(trust_env=False, timeout=READY_S) as client:
        deadline = time.monotonic() + READY_S
        while client.get(f"{desk.url}/readyz").status_code != 200:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        return client.post(f"{desk.url}/plan", json=request).raise_for_status().json()["id"]
