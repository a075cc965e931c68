"""Reports of landings: what is stored, what is refused, who may."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from click.testing import CliRunner

from api.cli import main
from api.routes import landings
from planner.cell import load_cell
from tests.api.conftest import NO_ID, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of

POSITION = {"position": [1.21, 0.29, 0.0], "std_m": 0.003}
MISS = {"result": "miss", "radius_m": 0.1}


def queued(service: RunningService, plan: dict[str, Any], dry_run: bool = False) -> str:
    response = service.client.post("/execute", json={"plan_id": plan["id"], "dry_run": dry_run})
    assert response.status_code == 202, response.text
    return response.json()["id"]


@pytest.fixture
def thrown(service: RunningService, executor: FakeExecutor, plan: dict[str, Any]) -> str:
    """Returns an execution that threw its object."""
    id = queued(service, plan)
    service.store.finish_execution(id, "completed", None, {"released": True})
    return id


def report(service: RunningService, id: str, body: Any, **headers: str) -> Any:
    return service.client.post(f"/executions/{id}/landing", json=body, headers=headers)


def test_several_observations_of_a_throw_are_kept_as_they_were_reported(service: RunningService, thrown: str):
    service.store.add_landing("a", thrown, 5.0, "sim-camera", position=[1.2, 0.3, 0.0], std_m=0.0)
    first = report(service, thrown, POSITION)
    second = report(service, "latest", {**MISS, "source": "camera-2"})
    assert (first.status_code, second.status_code) == (201, 201)
    assert first.headers["location"] == f"/executions/{thrown}/landing"
    found = service.client.get(f"/executions/{thrown}/landing").json()
    assert found["execution_id"] == thrown
    assert {(row["source"], row["reported_by"]) for row in found["landings"]} == {
        ("sim-camera", ""),
        ("person", "local"),
        ("camera-2", "local"),
    }
    person = next(row for row in found["landings"] if row["source"] == "person")
    assert person == first.json()
    assert (person["position"], person["std_m"], person["result"]) == ([1.21, 0.29, 0.0], 0.003, None)
    assert (second.json()["result"], second.json()["radius_m"]) == ("miss", 0.1)
    assert [line["action"] for line in service.store.audit_lines(2)] == ["landing", "landing"]


def test_a_place_in_millimetres_is_refused(service: RunningService, thrown: str):
    answer = report(service, thrown, {"position": [1200.0, 300.0, 0.0], "std_m": 0.005})
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == ["position[0]", "position[1]"]


def test_a_place_far_from_the_world_s_origin_may_be_near_the_arm(
    service: RunningService, thrown: str, monkeypatch: pytest.MonkeyPatch
):
    here = load_cell(service.settings.cells / "ur5e-sim.toml")
    X_WB = here.X_WB.copy()
    X_WB[:3, 3] = [150.0, 0.0, 0.0]
    monkeypatch.setattr(landings, "_cell_of", lambda *_: replace(here, X_WB=X_WB))
    assert report(service, thrown, {"position": [150.9, 0.0, 0.0], "std_m": 0.005}).status_code == 201
    answer = report(service, thrown, {"position": [0.9, 0.0, 0.0], "std_m": 0.005})
    assert [error["field"] for error in answer.json()["errors"]] == ["position[0]"]
    assert "0.9 m is 100 m or more from the arm" in answer.json()["errors"][0]["reason"]


def test_the_same_key_is_one_observation(service: RunningService, thrown: str):
    headers = {"Idempotency-Key": f"key of {thrown}"}
    first = report(service, thrown, POSITION, **headers)
    again = report(service, thrown, POSITION, **headers)
    assert (again.status_code, again.json()) == (201, first.json())
    assert len(service.store.landings(thrown)) == 1
    problem_of(report(service, thrown, MISS, **headers), 422, "idempotency-conflict")


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "body"),
        ({"position": [1.0, 2.0, 0.0]}, "body"),
        ({**POSITION, **MISS}, "body"),
        ({**POSITION, "radius_m": 0.1}, "body"),
        ({"result": "miss"}, "body"),
        ({**POSITION, "std_m": -0.001}, "std_m"),
        ({**POSITION, "position": [1.0, 2.0]}, "position"),
        ({"result": "nearly", "radius_m": 0.1}, "result"),
        ({"result": "hit", "radius_m": 0.0}, "radius_m"),
        ({**POSITION, "source": "sim-camera"}, "source"),
        ({**POSITION, "source": "a b"}, "source"),
        ({**POSITION, "where": "there"}, "where"),
    ],
)
def test_what_says_nothing_is_refused(service: RunningService, thrown: str, body: Any, field: str):
    problem = problem_of(report(service, thrown, body), 422, "invalid-request")
    assert [error["field"] for error in problem["errors"]] == [field]
    assert service.store.landings(thrown) == []


def test_an_execution_that_threw_nothing_has_no_landing(service: RunningService, executor: FakeExecutor, plan):
    id = queued(service, plan)
    assert "queued" in problem_of(report(service, id, POSITION), 409, "nothing-thrown")["detail"]
    service.store.finish_execution(id, "completed", None, {"released": False})
    assert "not commanded to open" in problem_of(report(service, id, POSITION), 409, "nothing-thrown")["detail"]
    dry = queued(service, plan, dry_run=True)
    service.store.finish_execution(dry, "completed")
    assert "a dry run" in problem_of(report(service, dry, POSITION), 409, "nothing-thrown")["detail"]
    for outcome, reason in (("aborted", "the abort came before anything moved"), ("refused", "the arm is not at rest")):
        never_begun = queued(service, plan)
        service.store.finish_execution(never_begun, outcome, reason)
        detail = problem_of(report(service, never_begun, POSITION), 409, "nothing-thrown")["detail"]
        assert detail == f"execution {never_begun} was {outcome}: {reason}"
    problem_of(report(service, "nothing", POSITION), 404, "not-found")


class ServiceClientHere:
    """Stands in for the HTTP client of the command line: the same calls, to the service in this process."""

    def __init__(self, service: RunningService) -> None:
        self.service = service

    def __call__(self, url: str, token: str | None) -> ServiceClientHere:
        return self

    def __enter__(self) -> ServiceClientHere:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def get(self, path: str) -> Any:
        return self.service.client.get(path).json()

    def post(self, path: str, body: Any) -> Any:
        response = self.service.client.post(path, json=body)
        assert response.status_code in (200, 201), response.text
        return response.json()


def test_the_command_line_reports_and_lists(service: RunningService, thrown: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("api.cli.support.client.ServiceClient", ServiceClientHere(service))

    def fling(*arguments: str) -> Any:
        result = CliRunner().invoke(main, ["landing", thrown, *arguments, "--yes"])
        assert result.exit_code == 0, result.output
        return result.output

    assert "no landing" in fling()
    assert "(1.2000, -0.3000, 0.0000) m ± 0.0050 m  (person, local)" in fling("1.2", "-0.3", "0")
    assert "miss of 0.100 m" in fling("--miss", "0.1", "--source", "camera-2")
    assert len(fling().splitlines()) == 2
    rows = service.store.landings(thrown)
    assert [(row.position, row.std_m, row.result) for row in rows] == [
        ([1.2, -0.3, 0.0], 0.005, None),
        (None, None, "miss"),
    ]
    for given, words in (
        (["1.2", "0.3"], "three coordinates, X Y Z; 2 were given"),
        (["1.2", "0.3", "0", "--hit", "0.1"], "X Y Z and --hit were given"),
    ):
        refused = CliRunner().invoke(main, ["landing", thrown, *given])
        assert refused.exit_code == 64
        assert words in refused.output


def test_a_withdrawn_report_is_kept_and_counts_nowhere(service: RunningService, thrown: str):
    wrong = report(service, thrown, {"position": [9.0, 9.0, 9.0], "std_m": 0.003}).json()
    right = report(service, thrown, POSITION).json()
    path = f"/executions/{thrown}/landing/{wrong['id']}/withdraw"
    answer = service.client.post(path)
    assert answer.status_code == 200, answer.text
    assert answer.json()["withdrawn_by"] == "local"
    assert service.store.audit_lines(1)[0]["action"] == "withdraw"
    assert service.store.audit_lines(1)[0]["resource"].endswith(wrong["id"])
    assert service.client.post(path).json() == answer.json()  # once is enough
    listed = service.client.get(f"/executions/{thrown}/landing").json()["landings"]
    assert [row["withdrawn_at"] is None for row in listed] == [False, True]
    assert [row.id for row in service.store.landings(thrown)] == [right["id"]]  # what learning reads
    problem_of(service.client.post(f"/executions/{thrown}/landing/{NO_ID}/withdraw"), 404, "not-found")


def test_the_command_line_names_the_throw_and_asks_about_a_slip(
    service: RunningService, thrown: str, plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("api.cli.support.client.ServiceClient", ServiceClientHere(service))
    invoke = CliRunner().invoke
    far = invoke(main, ["landing", thrown, "9", "9", "9"])
    assert far.exit_code == 1
    assert "m from there" in far.output
    assert service.store.landings(thrown) == []
    x, y, z = plan["flight"]["landing_point"]
    near = invoke(main, ["landing", thrown, str(x), str(y), str(z)])
    assert near.exit_code == 0, near.output
    assert f"throw {thrown} of " in near.output
    assert "which was to land at" in near.output
    gone = invoke(main, ["landing", thrown, "--withdraw", "latest"])
    assert gone.exit_code == 0, gone.output
    assert "withdrawn" in gone.output
    assert service.store.landings(thrown) == []


def test_latest_of_a_series_is_asked_about(
    service: RunningService, executor: FakeExecutor, plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("api.cli.support.client.ServiceClient", ServiceClientHere(service))
    series = service.client.post("/experiments", json={"name": "series", "settings": {}}).json()["id"]
    answer = service.client.post("/execute", json={"plan_id": plan["id"], "experiment_id": series})
    id = answer.json()["id"]
    service.store.finish_execution(id, "completed", None, {"released": True})
    place = [str(x) for x in plan["flight"]["landing_point"]]
    asked = CliRunner().invoke(main, ["landing", "latest", *place])
    assert asked.exit_code == 1
    assert id in asked.output
    assert "last of a series" in asked.output
    assert CliRunner().invoke(main, ["landing", id, *place]).exit_code == 0  # by its id there is no doubt
