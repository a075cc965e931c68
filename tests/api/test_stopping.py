"""A stop reaches the executor of this machine, whatever the database and the threads of the service do."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio.to_thread
import pytest

from executor.execution import Execution
from executor.stop_listener import StopListener
from fling import stop_socket
from store import ExecutionRow
from tests.api.conftest import FakeExecutor, RunningService
from tests.executor.test_stop_listener import StoppedRun
from tests.postgres import POSTGRES
from tests.waiting import until


class ExecutorHere(StopListener):
    """The executor of a cell on this machine, with a claimed execution that runs."""

    def __init__(self, data: Path, row: ExecutionRow) -> None:
        folder = stop_socket.executor_folder(data, row.cell)
        folder.mkdir(parents=True, exist_ok=True)
        super().__init__(folder)
        self.stopped = StoppedRun()
        self.execution = Execution(session=None, row=row, run=self.stopped)


@pytest.fixture
def here(service: RunningService, data: Path, executor: FakeExecutor, plan: dict[str, Any]) -> Iterator[ExecutorHere]:
    service.client.post("/execute", json={"plan_id": plan["id"]}).raise_for_status()
    row = service.store.claim_execution("ur5e-sim", "fake")
    assert row is not None
    found = ExecutorHere(data, row)
    found.start()
    until((found.folder / "stop").exists, period_s=0.0)
    yield found
    found.stop()


@contextlib.contextmanager
def locked(service: RunningService) -> Iterator[None]:
    """Locks the service's database, so that every writer waits."""
    with contextlib.closing(sqlite3.connect(service.settings.database_url.removeprefix("sqlite:///"))) as other:
        other.execute("BEGIN EXCLUSIVE")
        yield
        other.rollback()


def test_the_executor_brakes_and_the_database_knows(service: RunningService, here: ExecutorHere):
    id = here.execution.row.id
    response = service.client.post(f"/executions/{id}/abort")
    assert response.status_code == 202
    assert here.stopped.asked.is_set()
    assert service.store.abort_requested(id)
    assert service.store.audit_lines(1)[0]["action"] == "abort"


def test_an_executor_of_another_version_is_stopped(
    service: RunningService, here: ExecutorHere, monkeypatch: pytest.MonkeyPatch
):
    own = here._answer

    def other_version(message: dict[str, Any]) -> dict[str, Any]:
        answer = {**(own(message) or {}), "field_of_another_version": 1}
        answer.pop("mode")
        return answer

    monkeypatch.setattr(here, "_answer", other_version)
    id = here.execution.row.id
    response = service.client.post(f"/executions/{id}/abort")
    assert response.status_code == 202, response.text
    assert here.stopped.asked.is_set()
    assert service.store.abort_requested(id)


@pytest.mark.skipif(POSTGRES is not None, reason="SQLite's lock")
@pytest.mark.parametrize("name", ["id", "latest"])
def test_a_locked_database_keeps_nobody_from_stopping(service: RunningService, here: ExecutorHere, name: str):
    row = here.execution.row
    with locked(service):
        response = service.client.post(f"/executions/{row.id if name == 'id' else name}/abort")
    assert response.status_code == 202, response.text
    assert here.stopped.asked.is_set()
    answer = response.json()
    assert (answer["id"], answer["plan_id"], answer["cell"]) == (row.id, row.plan_id, row.cell)
    assert answer["abort_requested_at"]
    assert answer["executor_lost"] is False


def test_threads_that_all_wait_keep_nobody_from_stopping(service: RunningService, here: ExecutorHere):
    """As where the database does not answer at all: each request to it holds a thread for ever."""
    portal = service.client.portal
    limiter = portal.call(anyio.to_thread.current_default_thread_limiter)
    waiting = [object() for _ in range(int(limiter.total_tokens))]
    for one in waiting:
        portal.call(limiter.acquire_on_behalf_of, one)
    try:
        response = service.client.post(f"/executions/{here.execution.row.id}/abort")
    finally:
        for one in waiting:
            portal.call(limiter.release_on_behalf_of, one)
    assert response.status_code == 202
    assert here.stopped.asked.is_set()


def test_what_nobody_here_runs_is_asked_of_the_database(service: RunningService, here: ExecutorHere):
    here.execution = None
    id = service.store.open_execution("ur5e-sim")
    assert service.client.post(f"/executions/{id}/abort").status_code == 202
    assert service.store.abort_requested(str(id))
    assert here.is_asked(str(id))  # so that it does not begin either


@pytest.mark.skipif(POSTGRES is not None, reason="SQLite's lock")
def test_what_has_ended_is_told_before_a_locked_database_is_free(service: RunningService, here: ExecutorHere):
    here.execution = None
    id = str(service.store.open_execution("ur5e-sim"))
    service.store.finish_execution(id, "completed", "", {})
    with locked(service):
        response = service.client.post(f"/executions/{id}/abort")
    assert (response.status_code, response.json()["outcome"]) == (202, "completed")
