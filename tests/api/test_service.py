"""Health, cells, pages, and what OpenAPI promises."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from api import store_probe
from api.app import UnsafeSettings, create_app
from api.http import PROBLEM_TYPES, create_token
from api.schemas import TARGET_EXAMPLES
from api.settings import ServiceSettings
from store import Store, StoreUnavailable, pack_samples
from tests.api.conftest import REQUEST, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of


def test_alive_ready_and_measured(service: RunningService, executor: FakeExecutor, plan):
    assert service.client.get("/healthz").json()["status"] == "ok"
    ready = service.client.get("/readyz").json()
    assert (ready["ready"], ready["store"], ready["planner"]) == (True, True, True)
    assert ready["cells"]["ur5e-sim"] is True
    assert ready["cells"]["real"] is False
    text = service.client.get("/metrics").text
    assert 'fling_plans_total{result="planned"}' in text
    assert 'fling_executor_alive{cell="ur5e-sim"} 1.0' in text


@pytest.mark.parametrize(("cause", "kind"), [(OSError(28, "no room"), "disk_full"), (OSError("gone"), "unreachable")])
def test_a_store_that_is_gone_or_full_is_not_ready(
    service: RunningService, monkeypatch: pytest.MonkeyPatch, cause: OSError, kind: str
):
    def fail(_: Store) -> None:
        raise StoreUnavailable(cause)

    monkeypatch.setattr(type(service.store), "check_writable", fail)
    monkeypatch.setattr(store_probe, "FRESH_S", 0.0)
    problem = problem_of(service.client.get("/readyz"), 503, "not-ready")
    assert (problem["store"], problem["outage"]) == (False, kind)
    assert service.client.get("/healthz").status_code == 200
    monkeypatch.undo()
    monkeypatch.setattr(store_probe, "FRESH_S", 0.0)
    assert service.client.get("/readyz").status_code == 200


def test_no_new_work_begins_where_no_room_is_left(
    service: RunningService, executor: FakeExecutor, plan, monkeypatch: pytest.MonkeyPatch
):
    """What `/readyz` calls a full disk is one for new work, too; what runs goes on, and can be stopped."""
    run = service.client.post("/execute", json={"plan_id": plan["id"]}).json()
    monkeypatch.setattr("store.store.free_bytes", lambda _: 5e6)
    monkeypatch.setattr(store_probe, "FRESH_S", 0.0)
    assert problem_of(service.client.get("/readyz"), 503, "not-ready")["outage"] == "disk_full"
    work = {
        "/plan": REQUEST,
        "/execute": {"plan_id": plan["id"]},
        "/batches": {"requests": [REQUEST]},
        "/experiments": {},
        "/cells/ur5e-sim/map": {"resolution_m": 2.0},
    }
    for path, body in work.items():
        assert problem_of(service.client.post(path, json=body), 503, "not-ready")["outage"] == "disk_full"
    assert service.client.post("/plan?store=false", json=REQUEST).status_code == 200
    assert service.client.get("/plans").status_code == 200
    assert service.client.post(f"/executions/{run['id']}/abort").status_code == 202


@pytest.fixture
def wrong_cells(cells: Path) -> Iterator[dict[str, str]]:
    """Yields cells by name with what is wrong with them, in the folder of the shared service."""
    text = (cells / "ur5e-sim.toml").read_text()
    contents = {
        "deep": ("home_rad = " + "[" * 5000, "nests deeper"),
        "long": ("a" + ".a" * 100_000 + " = 1", "nests deeper"),
        "digits": ("home_rad = " + "9" * 6000, "not TOML"),
        "dated": (text + '\n[kinematics]\ncalibration = "dated.yaml"\n', "dated.yaml"),
        "piped": (text + '\n[kinematics]\ncalibration = "piped.yaml"\n', "is a pipe"),
    }
    for name, (content, _) in contents.items():
        (cells / f"{name}.toml").write_text(content)
    (cells / "dated.yaml").write_text("kinematics: {hash: 2001-99-99, shoulder: " + "[" * 900 + "}")
    os.mkfifo(cells / "piped.yaml")
    os.mkfifo(cells / "pipe.toml")
    (cells / "folder.toml").mkdir()
    (cells / "link.toml").symlink_to("nowhere.toml")
    reasons = {name: reason for name, (_, reason) in contents.items()}
    yield {**reasons, "pipe": "is a pipe", "folder": "is a folder", "link": "No such file"}
    (cells / "folder.toml").rmdir()
    for name in ("dated.yaml", "piped.yaml", "pipe.toml", "link.toml", *(f"{name}.toml" for name in contents)):
        (cells / name).unlink()


@pytest.mark.slow
def test_a_wrong_file_among_the_cells_is_told_of_and_hinders_nobody(
    service: RunningService, wrong_cells: dict[str, str]
):
    answer = service.client.get("/cells")
    assert answer.status_code == 200, answer.text
    listed = {cell["name"]: cell for cell in answer.json()["cells"]}
    assert listed["ur5e-sim"]["error"] is None
    for name, reason in wrong_cells.items():
        assert reason in listed[name]["error"]
        for path in (f"/cells/{name}", f"/cells/{name}/state", f"/cells/{name}/model", f"/cells/{name}/timing"):
            problem = problem_of(service.client.get(path), 422, "invalid-request")
            assert reason in problem["detail"]
            assert len(problem["detail"]) < 1000
        request = {"cell": name, "release": {"kind": "target", "position": [1.0, 0.0, 0.0]}}
        for path, body in (("/plan", request), ("/batches", {"requests": [request]}), (f"/cells/{name}/map", {})):
            problem_of(service.client.post(path, json=body), 422, "invalid-request")
        assert service.client.get(f"/cells/{name}/history").json()["versions"] == []
        problem_of(service.client.get(f"/cells/{name}/profiles"), 422, "invalid-request")
        problem_of(service.client.post(f"/cells/{name}/profiles"), 422, "invalid-request")
        problem_of(service.client.get(f"/cells/{name}/map"), 422, "invalid-request")
    assert service.client.get("/readyz").status_code == 200


def test_the_list_and_the_state_of_cells(service: RunningService, executor: FakeExecutor):
    listed = {cell["name"]: cell for cell in service.client.get("/cells").json()["cells"]}
    assert set(listed) == {"ur5e-sim", "changing", "real", "wrong"}
    assert listed["ur5e-sim"]["executor"]["alive"] is True
    assert listed["ur5e-sim"]["default"] is True
    assert listed["real"]["link_kind"] == "ur"
    assert "unknown_key" in listed["wrong"]["error"]
    state = service.client.get("/cells/ur5e-sim/state").json()
    assert state["robot"] == executor.robot
    assert service.client.get("/cells/real/state").json()["robot"] is None


def test_a_cell_is_its_file(service: RunningService, root: Path):
    import hashlib
    import tomllib

    raw = (root / "cells" / "ur5e-sim.toml").read_bytes()
    answer = service.client.get("/cells/ur5e-sim").json()
    assert answer["sha256"] == hashlib.sha256(raw).hexdigest()

    def compare(written: dict[str, Any], answered: dict[str, Any]) -> None:
        for key, value in written.items():
            if isinstance(value, dict):
                compare(value, answered[key])
            else:
                assert answered[key] == value, key

    compare(tomllib.loads(raw.decode()), answer)


def test_every_problem_has_its_page(service: RunningService):
    for name, kind in PROBLEM_TYPES.items():
        page = service.client.get(f"/problems/{name}")
        assert page.status_code == 200
        assert str(kind.status) in page.text
        assert name in service.client.get("/problems").text


def test_pages_load_nothing_from_elsewhere(service: RunningService):
    for path in ("/", "/docs", "/problems"):
        page = service.client.get(path)
        assert page.status_code == 200
        assert page.headers["content-security-policy"].startswith("default-src 'self'")
        for link in re.findall(r'(?:src|href)="([^"]+)"', page.text):
            assert not re.match(r"(https?:)?//", link), link
            if link.startswith("/web/"):
                assert service.client.get(link).status_code == 200, link
        assert "onclick=" not in page.text
        assert "<style" not in page.text
        assert not re.search(r"<script(?![^>]* src=)", page.text)


def operations(schema: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            yield method, path, operation


def test_every_call_of_the_contract_is_there(service: RunningService):
    schema = service.client.get("/openapi.json").json()
    assert {f"{method.upper()} {path}" for method, path, _ in operations(schema)} == {
        "POST /plan",
        "GET /plans",
        "GET /plans/{id}",
        "GET /plans/{id}/trajectory",
        "POST /execute",
        "GET /executions",
        "POST /executions/{id}/landing",
        "POST /executions/{id}/landing/{landing}/withdraw",
        "GET /executions/{id}/landing",
        "POST /batches",
        "GET /batches",
        "GET /batches/{id}",
        "GET /batches/{id}/events",
        "GET /batches/{id}/results",
        "POST /batches/{id}/cancel",
        "POST /jobs",
        "GET /jobs",
        "GET /jobs/{id}",
        "GET /jobs/{id}/events",
        "GET /jobs/{id}/results",
        "POST /jobs/{id}/pause",
        "POST /jobs/{id}/resume",
        "POST /jobs/{id}/cancel",
        "POST /cells/{name}/map",
        "GET /cells/{name}/map",
        "POST /cells/{name}/map/cancel",
        "POST /experiments",
        "GET /experiments",
        "GET /experiments/{id}",
        "GET /executions/{id}",
        "GET /executions/{id}/events",
        "GET /executions/{id}/recording",
        "POST /executions/{id}/abort",
        "POST /executions/{id}/replace",
        "POST /cells/{name}/acknowledge",
        "POST /cells/{name}/robot",
        "POST /cells/{name}/retarget",
        "POST /cells/{name}/targets",
        "GET /cells/{name}/targets",
        "GET /cells/{name}/targets/{id}",
        "DELETE /cells/{name}/targets/{id}",
        "POST /cells/{name}/targets/{id}/observations",
        "GET /cells",
        "GET /cells/{name}",
        "GET /cells/{name}/history",
        "GET /cells/{name}/model",
        "GET /plans/{id}/curves",
        "GET /cells/{name}/timing",
        "GET /cells/{name}/calibration",
        "GET /cells/{name}/profiles",
        "POST /cells/{name}/profiles",
        "POST /cells/{name}/profiles/revert",
        "GET /profiles/{id}",
        "POST /profiles/{id}/adopt",
        "GET /cells/{name}/state",
        "GET /healthz",
        "GET /readyz",
        "GET /metrics",
    }


def test_every_reference_of_the_schema_resolves(service: RunningService):
    schema = service.client.get("/openapi.json").json()
    for name in re.findall(r"#/components/schemas/(\w+)", str(schema)):
        assert name in schema["components"]["schemas"], name


def test_every_field_of_a_request_is_described(service: RunningService):
    schemas = service.client.get("/openapi.json").json()["components"]["schemas"]
    for model in (
        "PlanRequest",
        "ExecuteRequest",
        "BatchRequest",
        "PoseReleaseRequest",
        "PointReleaseRequest",
        "JointReleaseRequest",
        "TargetReleaseRequest",
        "RequestLimits",
        "StartRequest",
        "Pose",
        "Twist",
    ):
        for field, described in schemas[model]["properties"].items():
            assert field == "kind" or described.get("description"), f"{model}.{field}"


def test_every_example_runs(service: RunningService, executor: FakeExecutor, plan):
    """Every call can be run from the OpenAPI page with the examples it offers."""
    schema = service.client.get("/openapi.json").json()
    tracked = TARGET_EXAMPLES["encoder"]["value"]  # is named by an example of a plan, which comes first
    assert service.client.post("/cells/ur5e-sim/targets", json=tracked).status_code == 201
    for method, path, operation in operations(schema):
        for parameter in operation.get("parameters", []):
            if parameter["in"] == "path":
                example = next(iter(parameter["examples"].values()))["value"]
                path = path.replace("{" + parameter["name"] + "}", example)
        content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
        bodies = [example["value"] for example in content.get("examples", {}).values()] or [None]
        for body in bodies:
            response = service.client.request(method, path, json=body)
            if path.endswith(("/replace", "/retarget")):  # nothing runs here
                problem_of(response, 409, "cannot-join")
                continue
            assert response.status_code < 300, f"{method} {path}: {response.text}"
            if method.upper() == "POST" and path.endswith(
                ("/map", "/batches", "/jobs")
            ):  # hours of planning, or of moving
                made = path if path.endswith("/map") else response.headers["Location"]
                assert service.client.post(f"{made}/cancel").status_code < 300
            if path == "/execute":
                service.store.add_recording(response.json()["id"], b"m", pack_samples(["t"], [[0.0]]))
                service.store.finish_execution(response.json()["id"], "completed")


def test_without_tokens_only_this_machine_may_listen(tmp_path: Path):
    with pytest.raises(UnsafeSettings, match="token"):
        create_app(ServiceSettings(host="0.0.0.0", database_url=f"sqlite:///{tmp_path / 'x.db'}"))


@pytest.mark.parametrize("host", ["evil.example", "192.168.1.2", "127.0.0.1.evil.example", ""])
def test_another_host_name_is_refused(service: RunningService, host: str):
    problem_of(service.client.get("/plans", headers={"Host": host}), 403, "forbidden")


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1:8000", "[::1]:8000", "127.4.5.6"])
def test_names_of_this_machine_are_fine(service: RunningService, host: str):
    assert service.client.get("/plans", headers={"Host": host}).status_code == 200


def test_another_page_may_not_post(service: RunningService):
    headers = {"Origin": "http://evil.example"}
    problem_of(service.client.post("/executions/latest/abort", headers=headers), 403, "forbidden")
    own = service.client.post("/executions/nothing/abort", headers={"Origin": "http://127.0.0.1:8000"})
    problem_of(own, 404, "not-found")


def test_every_operation_lists_what_it_may_answer(service: RunningService):
    schema = service.client.get("/openapi.json").json()
    assert "securitySchemes" not in schema["components"]
    for method, path, operation in operations(schema):
        answers = operation["responses"]
        body = "requestBody" in operation
        expected = {"403", "500", *(("422", "413", "415") if body else ()), *(("404",) if "{" in path else ())}
        assert expected <= set(answers), path
        assert "401" not in answers
        assert "security" not in operation
        assert "HTTPValidationError" not in str(operation)
        for status, answer in answers.items():
            if status >= "400":
                assert list(answer["content"]) == ["application/problem+json"], (path, status)
                assert all(PROBLEM_TYPES[name].status == int(status) for name in answer["x-problems"])
        assert re.fullmatch(r"[a-z]+(_[a-z]+)+", operation["operationId"]), method
    assert len({operation["operationId"] for _, _, operation in operations(schema)}) == len(list(operations(schema)))


def test_with_tokens_every_guarded_operation_says_so(tmp_path: Path, cells: Path):
    file = tmp_path / "tokens.toml"
    create_token(file, "x", ("plan",))
    schema = create_app(ServiceSettings(cells=cells, tokens_file=file)).openapi()
    for _, path, operation in operations(schema):
        is_open = path in ("/healthz", "/readyz")
        assert ("401" in operation["responses"]) is not is_open, path
        assert ("security" in operation) is not is_open, path
    assert schema["components"]["securitySchemes"]["HTTPBearer"]["scheme"] == "bearer"


MEDIA_TYPES = {
    "/plan 200": {"application/json", "text/event-stream"},
    "/plans/{id}/trajectory": {"application/json", "text/csv"},
    "/experiments/{id}": {"application/json", "text/csv", "application/vnd.apache.parquet"},
    "/cells/{name}/map": {"application/json", "application/zip", "image/png", "text/html"},
    "/batches/{id}/results": {"application/json", "text/csv", "application/vnd.apache.parquet"},
    "/batches/{id}/events": {"text/event-stream"},
    "/jobs/{id}/results": {"application/json", "text/csv", "application/vnd.apache.parquet"},
    "/jobs/{id}/events": {"text/event-stream"},
    "/executions/{id}/recording": {"application/octet-stream", "text/csv"},
    "/executions/{id}/events": {"text/event-stream"},
    "/metrics": {"text/plain"},
}
EVENTS = {
    "/plan": {"progress": "PlanProgress", "plan": "PlanAnswer", "problem": "ProblemAnswer"},
    "/batches/{id}/events": {"progress": "BatchAnswer"},
    "/jobs/{id}/events": {"progress": "JobAnswer"},
    "/executions/{id}/events": {"state": "StateEvent", "telemetry": "TelemetryEvent", "target": "TargetEvent"},
}


def test_media_types_are_those_that_are_answered(service: RunningService):
    for method, path, operation in operations(service.client.get("/openapi.json").json()):
        for status, answer in operation["responses"].items():
            if status.startswith("2"):
                expected = MEDIA_TYPES.get(path if method == "get" else f"{path} {status}", {"application/json"})
                assert set(answer["content"]) == expected, (method, path)
                for media, content in answer["content"].items():
                    own = "itemSchema" if media == "text/event-stream" else "schema"
                    assert content[own] and {"schema", "itemSchema"} & content.keys() == {own}, (method, path)


def test_who_may_ask_for_a_media_type_is_told_of_406(service: RunningService):
    found = {}
    for _, path, operation in operations(service.client.get("/openapi.json").json()):
        takes = any(parameter["name"] == "accept" for parameter in operation.get("parameters", ()))
        found[path] = found.get(path, False) or takes
        assert ("406" in operation["responses"]) is takes, path
    assert sum(found.values()) == 7


def test_every_422_of_a_body_in_order_is_told(service: RunningService):
    """A key that was used with another body, and what no motion does, are 422 beside what the schema refuses."""
    told = {}
    for method, path, operation in operations(service.client.get("/openapi.json").json()):
        answer = operation["responses"].get("422", {})
        told[method, path] = set(answer.get("description", "").replace("`", "").split(", "))
        keyed = any(parameter["name"] == "idempotency-key" for parameter in operation.get("parameters", ()))
        assert ("idempotency-conflict" in told[method, path]) is keyed, path
        assert "requestBody" not in operation or "invalid-request" in told[method, path], path
    assert told["post", "/plan"] == {"invalid-request", "infeasible", "idempotency-conflict"}


@pytest.mark.parametrize("path", EVENTS)
def test_each_event_of_a_stream_is_described(service: RunningService, path: str):
    schema = service.client.get("/openapi.json").json()
    operation = schema["paths"][path]["post" if path == "/plan" else "get"]
    stream = operation["responses"]["200"]["content"]["text/event-stream"]
    fields = [kind["properties"] for kind in stream["itemSchema"]["oneOf"]]
    models = {each["event"]["const"]: each["data"]["contentSchema"]["$ref"].rpartition("/")[2] for each in fields}
    assert models == EVENTS[path]
    assert set(models.values()) <= schema["components"]["schemas"].keys()
