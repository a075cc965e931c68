"""Experiments over HTTP: their throws, and statistics against numpy and arithmetic by hand."""

from __future__ import annotations

import csv
import io
import sys
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest

from api.http import ProblemDetails
from api.routes import experiments
from store import PlanRow, new_id
from tests.api.conftest import NO_ID, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of

TARGETS = ([1.2, 0.3, 0.0], [1.0, -0.2, 0.1])
ERRORS = np.array([[0.010, 0.020], [-0.030, 0.010], [0.005, -0.040]])


def add_plan(service: RunningService, target: list[float] | None) -> str:
    import orjson

    id = new_id()
    release = {"kind": "joint"} if target is None else {"kind": "target", "position": target}
    summary = orjson.dumps({"id": id, "request": {"release": release}})
    service.store.add_plan(PlanRow(id, 1.0, "ur5e-sim", "sha", "ruckig", summary))
    return id


def throw(service: RunningService, plan_id: str, experiment_id: str, outcome: str = "completed") -> str:
    row = service.store.queue_execution(plan_id, "ur5e-sim", experiment_id=experiment_id)
    service.store.finish_execution(row.id, outcome, metrics={"released": outcome == "completed"})
    return row.id


def land(service: RunningService, execution_id: str, position: Any, std_m: float = 0.003) -> None:
    service.store.add_landing(new_id(), execution_id, 1.0, "camera", position=position, std_m=std_m)


@pytest.fixture
def experiment(service: RunningService) -> str:
    body = {"name": "fingers", "settings": {"repeat": 3}}
    response = service.client.post("/experiments", json=body)
    assert response.status_code == 201, response.text
    id = response.json()["id"]
    assert response.headers["location"] == f"/experiments/{id}"
    first, second = (add_plan(service, target) for target in TARGETS)
    for error in ERRORS:
        land(service, throw(service, first, id), [*np.add(TARGETS[0][:2], error), 0.0])
    missed = throw(service, second, id)
    service.store.add_landing(new_id(), missed, 1.0, "person", result="miss", radius_m=0.1)
    throw(service, second, id, "late")
    return id


def test_mean_and_spread_are_those_of_the_landings_about_their_targets(service: RunningService, experiment: str):
    found = service.client.get(f"/experiments/{experiment}").json()
    assert (found["name"], found["settings"], found["created_by"]) == ("fingers", {"repeat": 3}, "local")
    whole = found["statistics"]
    assert (whole["throws"], whole["landed"]) == (5, 3)
    assert whole["outcomes"] == {"completed": 4, "late": 1}
    assert whole["results"] == {"miss": 1}
    np.testing.assert_allclose(whole["mean_error_m"], [-0.005, -0.01 / 3], atol=1e-12)
    np.testing.assert_allclose(whole["covariance_m2"], np.cov(ERRORS.T), atol=1e-12)
    distances = np.linalg.norm(ERRORS, axis=1)
    assert whole["median_distance_m"] == pytest.approx(np.median(distances))
    assert whole["largest_distance_m"] == pytest.approx(distances.max())
    first, second = found["targets"]
    assert (first["target"], first["throws"], first["landed"]) == (TARGETS[0], 3, 3)
    assert (second["target"], second["throws"], second["mean_error_m"]) == (TARGETS[1], 2, None)
    assert [t["outcome"] for t in found["throws"]] == ["completed"] * 4 + ["late"]
    np.testing.assert_allclose([t["error_m"] for t in found["throws"][:3]], distances, atol=1e-12)
    assert service.client.get("/experiments/latest").json() == found


def test_several_observations_count_by_their_certainty(service: RunningService):
    id = service.client.post("/experiments", json={}).json()["id"]
    execution = throw(service, add_plan(service, TARGETS[0]), id)
    land(service, execution, [1.0, 0.0, 0.0], std_m=0.001)
    land(service, execution, [2.0, 0.0, 0.0], std_m=0.002)
    (found,) = service.client.get(f"/experiments/{id}").json()["throws"]
    assert found["landing"] == pytest.approx([1.2, 0.0, 0.0])  # weights 4 to 1
    land(service, execution, [7.0, 7.0, 0.0], std_m=0.0)
    (found,) = service.client.get(f"/experiments/{id}").json()["throws"]
    assert found["landing"] == pytest.approx([7.0, 7.0, 0.0])


def test_a_release_without_a_target_has_a_landing_and_no_error(service: RunningService):
    id = service.client.post("/experiments", json={}).json()["id"]
    land(service, throw(service, add_plan(service, None), id), [1.0, 0.0, 0.0])
    found = service.client.get(f"/experiments/{id}").json()
    assert (found["throws"][0]["target"], found["throws"][0]["error_m"]) == (None, None)
    assert (found["statistics"]["landed"], found["statistics"]["covariance_m2"]) == (0, None)


def test_the_table_as_parquet(service: RunningService, experiment: str):
    """Read back by the format's own library: types, nulls and lists as they are in JSON."""
    parquet = pytest.importorskip("pyarrow.parquet")
    kind = "application/vnd.apache.parquet"
    response = service.client.get(f"/experiments/{experiment}", headers={"Accept": kind})
    assert response.headers["content-type"] == kind
    rows = parquet.read_table(io.BytesIO(response.content)).to_pylist()
    throws = service.client.get(f"/experiments/{experiment}").json()["throws"]
    for row, throw in zip(rows, throws, strict=True):
        assert {name: row[name] for name in ("execution_id", "plan_id", "state", "outcome")} == {
            name: throw[name] for name in ("execution_id", "plan_id", "state", "outcome")
        }
        for place in ("target", "landing"):
            found = [row[f"{place}_{axis}_m"] for axis in "xyz"]
            assert found == (throw[place] or [None] * 3)
        assert (row["error_m"], row["results"]) == (throw["error_m"], throw["results"])
    empty = service.client.post("/experiments", json={}).json()["id"]
    table = parquet.read_table(
        io.BytesIO(service.client.get(f"/experiments/{empty}", headers={"Accept": kind}).content)
    )
    assert (table.num_rows, table.num_columns) == (0, 12)


def test_parquet_without_its_library_names_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ProblemDetails, match=r"fling-robotics\[parquet\]"):
        experiments._table([], experiments.PARQUET)


def test_the_table_as_csv_and_the_picture(service: RunningService, experiment: str):
    response = service.client.get(f"/experiments/{experiment}", headers={"Accept": "text/csv"})
    assert response.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(response.text)))
    assert [row["outcome"] for row in rows] == ["completed"] * 4 + ["late"]
    assert float(rows[0]["landing_x_m"]) == pytest.approx(1.21)
    assert (rows[3]["landing_x_m"], rows[3]["error_m"], rows[3]["results"]) == ("", "", "miss")
    picture = service.client.get(f"/experiments/{experiment}/picture.svg")
    assert picture.headers["content-type"] == "image/svg+xml"
    root = ET.fromstring(picture.text)
    dots = [c for c in root.iter("{http://www.w3.org/2000/svg}circle") if c.get("class") == "landing"]
    assert len(dots) == 3
    centre = 210.0
    (x, y) = (float(dots[0].get("cx", "")), float(dots[0].get("cy", "")))
    assert (x - centre) / (centre - y) == pytest.approx(0.010 / 0.020, abs=0.01)


def test_executions_join_by_name_and_keys_repeat(service: RunningService, executor: FakeExecutor, plan: dict[str, Any]):
    headers = {"Idempotency-Key": "experiment"}
    first = service.client.post("/experiments", json={"name": "one"}, headers=headers)
    again = service.client.post("/experiments", json={"name": "one"}, headers=headers)
    assert (again.status_code, again.json()) == (201, first.json())
    id = first.json()["id"]
    body = {"plan_id": plan["id"], "experiment_id": id}
    row = service.client.post("/execute", json=body).json()
    assert row["experiment_id"] == id
    throws = service.client.get(f"/experiments/{id}").json()["throws"]
    assert [(t["execution_id"], t["state"], t["outcome"]) for t in throws] == [(row["id"], "queued", None)]
    listed = service.client.get("/experiments?limit=1").json()
    assert listed["experiments"][0]["id"] == id
    service.store.close_open_executions("ur5e-sim")
    problem_of(service.client.post("/execute", json={**body, "experiment_id": NO_ID}), 404, "not-found")
    problem_of(service.client.get("/experiments/nothing"), 404, "not-found")
    problem_of(service.client.post("/experiments", json={"title": "x"}), 422, "invalid-request")
