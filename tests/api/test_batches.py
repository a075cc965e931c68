"""Batches over HTTP: a small real one, planned by a driver process of the service; and what is refused."""

from __future__ import annotations

import asyncio
import csv
import json
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from api.batch_requests import batch_specification
from api.cell_repository import CellRepository
from api.planning import BatchDrivers, DriverCommand
from api.schemas import BatchRequest
from api.settings import ServiceSettings
from store import Store
from tests.api.conftest import JOINT, NO_ID, REQUEST, RunningService, running
from tests.api.test_bad_input import problem_of
from tests.processes import children_with
from tests.waiting import until

OTHER = {**JOINT, "positions": [0.5, *JOINT["positions"][1:]]}
UNREACHABLE = {"kind": "point", "position": [9.0, 0.0, 0.5], "velocity": [1.0, 0.0, 0.0]}
BATCH = {
    "requests": [
        REQUEST,
        {**REQUEST, "release": OTHER},
        REQUEST,
        {"release": UNREACHABLE, "backend": "ruckig"},
    ]
}
BEGUN_S = 0.5  # [s] a driver is begun at once
DONE_S = 180.0  # [s] a driver and its workers start first, on a busy machine


def wait_for(service: RunningService, id: str) -> dict[str, Any]:
    deadline = time.monotonic() + DONE_S
    while (batch := service.client.get(f"/batches/{id}").json())["state"] != "finished":
        assert time.monotonic() < deadline, batch
        time.sleep(0.2)
    return batch


@pytest.fixture(scope="module")
def batch(shared: RunningService) -> dict[str, Any]:
    """Returns a finished batch."""
    answer = shared.client.post("/batches", json=BATCH, headers={"Idempotency-Key": "batch"})
    assert answer.status_code == 201, answer.text
    created = answer.json()
    assert answer.headers["Location"] == f"/batches/{created['id']}"
    assert (created["total"], created["outcome"]) == (4, None)
    return wait_for(shared, created["id"])


def test_every_request_has_a_result(service: RunningService, batch: dict[str, Any]):
    assert (batch["outcome"], batch["done"]) == ("completed", 4)
    assert batch["counts"] == {"planned": 3, "infeasible": 1}
    answer = service.client.get(f"/batches/{batch['id']}/results").json()
    results = answer["results"]
    assert answer["next_cursor"] is None
    assert [result["number"] for result in results] == [0, 1, 2, 3]
    assert results[0]["plan_id"] == results[2]["plan_id"] != results[1]["plan_id"]
    assert results[3]["refusal"]["name"] == results[3]["outcome"] == "infeasible"
    assert results[3]["refusal"]["violations"][0]["constraint"]
    assert [result["parameters"] for result in results] == [{}] * 4  # of a list


def test_plans_of_a_batch_are_plans(service: RunningService, batch: dict[str, Any]):
    result = service.client.get(f"/batches/{batch['id']}/results").json()["results"][0]
    plan = service.client.get(f"/plans/{result['plan_id']}").json()
    assert plan["certificate"]["valid"] is True
    assert plan["release_time_s"] == result["release_time_s"]
    assert plan["request"]["release"]["positions"] == JOINT["positions"]
    assert plan["cell_version"] == 1
    alone = service.plan()
    assert alone["trajectory"] == plan["trajectory"]
    listed = service.client.get("/plans", params={"limit": 200}).json()["plans"]
    assert result["plan_id"] in [one["id"] for one in listed]


def test_the_same_key_is_the_same_batch(service: RunningService, batch: dict[str, Any]):
    again = service.client.post("/batches", json=BATCH, headers={"Idempotency-Key": "batch"})
    assert (again.status_code, again.json()["id"]) == (201, batch["id"])
    other = service.client.post("/batches", json={"requests": [REQUEST]}, headers={"Idempotency-Key": "batch"})
    problem_of(other, 422, "idempotency-conflict")


def test_results_are_paged_and_tables(service: RunningService, batch: dict[str, Any]):
    path = f"/batches/{batch['id']}/results"
    first = service.client.get(path, params={"limit": 3}).json()
    second = service.client.get(path, params={"limit": 3, "cursor": first["next_cursor"]}).json()
    assert [result["number"] for result in first["results"] + second["results"]] == [0, 1, 2, 3]
    assert service.client.get(path, params={"cursor": 2**31 - 1}).json() == {"results": [], "next_cursor": None}
    problem_of(service.client.get(path, params={"cursor": 2**31}), 422, "invalid-request")  # no integer of PostgreSQL
    table = service.client.get(path, headers={"Accept": "text/csv"})
    assert table.headers["Content-Type"].startswith("text/csv")
    rows = list(csv.DictReader(table.text.splitlines()))
    assert [row["outcome"] for row in rows] == ["planned", "planned", "planned", "infeasible"]
    assert rows[0]["plan_id"] == first["results"][0]["plan_id"]
    problem_of(service.client.get(path, headers={"Accept": "image/png"}), 406, "not-acceptable")


def test_results_are_parquet(service: RunningService, batch: dict[str, Any], tmp_path: Path):
    pyarrow = pytest.importorskip("pyarrow.parquet")
    answer = service.client.get(f"/batches/{batch['id']}/results", headers={"Accept": "application/vnd.apache.parquet"})
    (tmp_path / "t.parquet").write_bytes(answer.content)
    table = pyarrow.read_table(tmp_path / "t.parquet")
    assert table.column("outcome").to_pylist() == ["planned", "planned", "planned", "infeasible"]


def test_progress_is_streamed(service: RunningService, batch: dict[str, Any]):
    with service.client.stream("GET", f"/batches/{batch['id']}/events") as answer:
        assert answer.headers["Content-Type"].startswith("text/event-stream")
        text = "".join(answer.iter_text())
    (event,) = [block for block in text.split("\n\n") if "event: progress" in block]
    assert json.loads(event.split("data: ")[1]) == service.client.get(f"/batches/{batch['id']}").json()


def test_latest_and_nothing(service: RunningService, batch: dict[str, Any]):
    assert service.client.get("/batches/latest").status_code == 200
    assert batch["id"] in [one["id"] for one in service.client.get("/batches").json()["batches"]]
    for path in ("", "/events", "/results"):
        problem_of(service.client.get(f"/batches/{NO_ID}{path}"), 404, "not-found")
    problem_of(service.client.post(f"/batches/{NO_ID}/cancel"), 404, "not-found")


TARGET = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}


@pytest.mark.parametrize(
    ("body", "field", "reason"),
    [
        ({}, "body", "either requests, or template and grid"),
        ({"requests": [REQUEST], "template": TARGET, "grid": {"backend": [1, 2, 1]}}, "body", "either requests"),
        ({"template": TARGET}, "body", "either requests"),
        ({"requests": []}, "requests", "at least 1"),
        (
            {"requests": [REQUEST, {"release": {**JOINT, "velocities": ["fast"] * 6}}]},
            "requests[1].release.velocities[0]",
            "must be a number",
        ),
        ({"requests": [REQUEST, {**REQUEST, "cell": "nowhere"}]}, "requests[1].cell", "no cell 'nowhere'"),
        ({"requests": [REQUEST, {**REQUEST, "cell": ""}]}, "requests[1].cell", "must not be empty"),
        ({"template": TARGET, "grid": {"cell": {"values": ["ur5e-sim", "no"]}}}, "requests[1].cell", "no cell 'no'"),
        *[
            ({"requests": [REQUEST, other]}, "requests[1]", "must be a JSON object")
            for other in (5, None, "x", [], True)
        ],
        (
            {"requests": [{**REQUEST, "start": {"execution": "latest", "at_s": 0.1}}]},
            "requests[0].start.execution",
            "positions",
        ),
        (
            {"requests": [{"release": {**TARGET["release"], "velocity": [0.1, 0.0, 0.0], "observed_at_s": 0.0}}]},
            "requests[0].starts_not_before_s",
            "is missing",
        ),
        ({"requests": [REQUEST, {**REQUEST, "start": {"current": True}}]}, "requests[1].start.current", "positions"),
        (
            {"template": TARGET, "grid": {"release.position[1]": {"values": [0.1, "left"]}}},
            "requests[1].release.position[1]",
            "must be a number",
        ),
        ({"template": TARGET, "grid": {"relaese.x": [0, 1, 1]}}, "requests[0].relaese", "there is no such field"),
        ({"template": TARGET, "grid": {"release.position[7]": [0, 1, 1]}}, "grid.release.position[7]", "no element 7"),
        ({"template": TARGET, "grid": {"release.position[0]": [0, 1, -1]}}, "grid.release.position[0]", "not lead"),
        (
            {"template": TARGET, "grid": {"release.position[0]": [1, 2]}},
            "grid.release.position[0]",
            "has 2 entries; an axis is [from, to, step], or",
        ),
        (
            {"template": TARGET, "grid": {"release.position[0]": [1e308, 1, "x"], "release.position[1]": [0, 1, 1]}},
            "grid.release.position[0]",
            "from must be at most 1000000; it is 1e+308; step must be a number; it is 'x'",
        ),
        (
            {"template": TARGET, "grid": {"release.position[0]": {"value": [1]}}},
            "grid.release.position[0]",
            "has other fields, or no values; an axis is [from, to, step], or",
        ),
        ({"template": TARGET, "grid": {"release.position[0]": 7}}, "grid.release.position[0]", "is a number; an axis"),
        ({"template": TARGET, "grid": {"release.position[0]": [0, 1, 1e-5]}}, "grid", "100001 requests; a batch"),
    ],
)
def test_a_wrong_batch_is_refused_before_anything_is_stored(
    service: RunningService, batch: dict[str, Any], body: dict[str, Any], field: str, reason: str
):
    before = service.client.get("/batches").json()["batches"]
    problem = problem_of(service.client.post("/batches", json=body), 422, "invalid-request")
    reasons = {error["field"]: error["reason"] for error in problem["errors"]}
    assert next(iter(reasons)) == field
    assert reason in reasons[field]
    assert service.client.get("/batches").json()["batches"] == before


def drivers_of(id: str) -> list[psutil.Process]:
    return children_with(id)


def test_a_driver_that_is_killed_is_begun_again(service: RunningService):
    """And a batch that waits behind it is cancelled at once."""
    axes = {"release.positions[0]": [0.30, 0.32, 0.01]}
    made = service.client.post("/batches", json={"template": REQUEST, "grid": axes}).json()
    other = service.client.post("/batches", json={"requests": [REQUEST]}).json()
    found: list[psutil.Process] = []
    until(lambda: found.extend(drivers_of(made["id"])) or found)
    found[0].kill()
    cancelled = service.client.post(f"/batches/{other['id']}/cancel")
    assert (cancelled.status_code, cancelled.json()["outcome"]) == (202, "cancelled")
    assert wait_for(service, made["id"])["counts"] == {"planned": 3}
    assert service.client.get(f"/batches/{other['id']}").json()["done"] == 0


def test_a_service_may_leave_the_planning_to_another_one(tmp_path: Path, cells: Path):
    url = f"sqlite:///{tmp_path / 'fling.db'}"
    settings = ServiceSettings(database_url=url, cells=cells, planner_workers=1, batch_workers=0)
    with running(settings) as service:
        id = service.client.post("/batches", json={"requests": [REQUEST]}).json()["id"]
        time.sleep(BEGUN_S)
        assert drivers_of(id) == []
        assert service.store.claim_batch(id, "another").state == "running"


@pytest.mark.slow
def test_a_batch_whose_driver_always_dies_fails_with_a_reason(tmp_path: Path, cells: Path):
    url = f"sqlite:///{tmp_path / 'fling.db'}"
    store = Store.open(url)
    specification = batch_specification(BatchRequest(requests=[REQUEST]), store, CellRepository(cells), "ur5e-sim", 9)
    id = store.add_batch(specification.pack(), 1).id

    async def until_finished() -> None:
        task = asyncio.create_task(BatchDrivers(store, DriverCommand(url, 1, "ray://nowhere:1")).run())
        while store.batch(id).state != "finished":
            await asyncio.sleep(0.1)
        task.cancel()

    asyncio.run(asyncio.wait_for(until_finished(), DONE_S))
    batch = store.batch(id)
    store.close()
    assert batch.outcome == "failed"
    assert "ray://nowhere:1: ray:// is not supported" in batch.reason
