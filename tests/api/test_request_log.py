"""Each request: its id, its line in the log, and refused acts in the audit trail."""

from __future__ import annotations

import logging
from typing import get_args

import orjson
import pytest
from fastapi.routing import APIRoute

from api.dependencies import OperateCaller
from api.http.request_log import ACTIONS
from api.logs import JsonFormatter, configure_logs
from api.routes import ROUTERS
from api.server import server_config
from store import StoreUnavailable
from tests.api.conftest import REQUEST, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of
from tests.api.test_executions import execute
from tests.api.test_tokens import bearer, guarded, tokens  # noqa: F401  # fixtures


def lines_of(caplog: pytest.LogCaptureFixture) -> list[dict]:
    return [orjson.loads(JsonFormatter().format(r)) for r in caplog.records if r.name == "fling.requests"]


def test_a_request_is_one_line_of_json(service: RunningService, caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.INFO, "fling.requests")
    service.client.get("/executions?cursor=secret-1", headers={"X-Request-ID": "mine-1"})
    (line,) = lines_of(caplog)
    assert (line["id"], line["method"], line["route"], line["path"]) == (
        "mine-1",
        "GET",
        "/executions",
        "/executions",
    )
    assert (line["status"], line["problem"], line["token"], line["client"]) == (
        422,
        "invalid-request",
        "local",
        "testclient",
    )
    assert line["ms"] >= 0.0
    assert "secret" not in orjson.dumps(line).decode()


def test_the_id_is_echoed_and_a_strange_one_replaced(service: RunningService):
    def echoed(id: str) -> str:
        return service.client.get("/healthz", headers={"X-Request-ID": id}).headers["x-request-id"]

    assert echoed("a.b:c/1") == "a.b:c/1"
    made = {echoed(id) for id in ("", "x" * 129, "a b", 'a"b')}
    assert len(made) == 4
    assert all(len(id) == 36 for id in made)


def test_the_id_is_kept_with_plan_execution_and_audit(service: RunningService, executor: FakeExecutor):
    plan = service.client.post("/plan", json=REQUEST, headers={"X-Request-ID": "plan-1"}).json()
    assert plan["request_id"] == service.store.plan(plan["id"]).request_id == "plan-1"
    body = {"plan_id": plan["id"]}
    run = service.client.post("/execute", json=body, headers={"X-Request-ID": "run-1"}).json()
    assert run["request_id"] == service.store.execution(run["id"]).request_id == "run-1"
    line = service.store.audit_lines(1)[0]
    assert (line["request_id"], line["action"], line["resource"]) == ("run-1", "execute", f"/executions/{run['id']}")
    assert (line["outcome"], line["remote"]) == ("done", "testclient")


def test_a_refused_act_is_audited_with_its_reason(service: RunningService, executor: FakeExecutor, plan):
    executor.fault = {"reason": "late"}
    executor.beat()
    problem = problem_of(execute(service, plan["id"]), 409, "robot-not-ready")
    line = service.store.audit_lines(1)[0]
    assert (line["action"], line["outcome"], line["resource"]) == ("execute", "robot-not-ready", "/execute")
    assert line["reason"] == problem["detail"]
    problem_of(service.client.post("/executions/nobody/abort"), 404, "not-found")
    assert service.store.audit_lines(1)[0]["outcome"] == "not-found"


def test_refusals_of_every_act_are_audited():
    """But for observations of a target: there are 30 of them a second."""
    operates = get_args(OperateCaller)[1].dependency
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    acts = {route.path for route in routes if any(each.call is operates for each in route.dependant.dependencies)}
    assert acts - ACTIONS.keys() == {"/cells/{name}/targets/{id}/observations"}


def test_an_act_without_a_right_to_it_is_audited(guarded: RunningService, tokens):  # noqa: F811
    cases = (({}, "unauthenticated", "unknown"), (bearer(tokens[1]["planner"]), "forbidden", "planner"))
    for headers, outcome, who in cases:
        guarded.client.post("/execute", json={"plan_id": "x"}, headers=headers)
        line = guarded.store.audit_lines(1)[0]
        assert (line["who"], line["action"], line["outcome"]) == (who, "execute", outcome)


def test_a_method_that_a_path_does_not_have_is_no_act(service: RunningService):
    before = service.store.audit_lines(9)
    for path in ("/execute", "/jobs", "/batches"):
        problem_of(service.client.delete(path), 405, "method-not-allowed")
    problem_of(service.client.post("/cells/ur5e-sim/targets/bin"), 405, "method-not-allowed")
    assert service.store.audit_lines(9) == before


def test_an_act_and_its_audit_line_are_stored_together_or_not_at_all(
    service: RunningService, executor: FakeExecutor, plan, monkeypatch: pytest.MonkeyPatch
):
    """The audit trail cannot be written: nothing is queued."""
    before = len(service.store.executions()[0])

    def fail(*_: object) -> None:
        raise StoreUnavailable(OSError("full"))

    monkeypatch.setattr("store.executions.write_audit", fail)
    problem_of(execute(service, plan["id"]), 503, "not-ready")
    assert len(service.store.executions()[0]) == before
    monkeypatch.undo()
    newest, *earlier = service.store.audit_lines(2)
    assert (newest["action"], newest["outcome"]) == ("execute", "not-ready")
    assert "not-ready" not in [line["outcome"] for line in earlier]


def test_counters_follow_executions_and_never_fall(service: RunningService, executor: FakeExecutor, plan):
    def value(name: str) -> float:
        text = service.client.get("/metrics").text
        return sum(float(line.rsplit(" ", 1)[1]) for line in text.splitlines() if line.startswith(name))

    done = 'fling_executions_total{cell="ur5e-sim",outcome="completed"}'
    before = value(done), value("fling_execution_missed_ticks_total"), value("fling_landing_error_meters_count")
    id = execute(service, plan["id"]).json()["id"]
    assert value('fling_executions_open{cell="ur5e-sim",state="queued"}') == 1.0
    measured = {"ticks": 900, "missed_ticks": 3, "tracking_error_max_rad": 0.004, "landing_error_m": 0.002}
    service.store.finish_execution(id, "completed", None, measured)
    assert value(done) == before[0] + 1
    assert value("fling_execution_missed_ticks_total") == before[1] + 3
    assert value("fling_landing_error_meters_count") == before[2] + 1
    assert value("fling_executions_open") == 0.0
    assert value(done) == before[0] + 1  # counted once
    assert value("fling_solve_seconds_count") >= 1
    assert value('fling_certificate_margin_ratio_count{check="joint_velocity"}') >= 1
    assert value('fling_http_requests_total{method="GET",route="/metrics"') >= 1


def test_a_bug_is_answered_counted_and_logged_like_any_answer(
    service: RunningService, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    def buggy(*_: object) -> None:
        raise RuntimeError("surprise")

    monkeypatch.setattr(service.store, "plans", buggy)
    caplog.set_level(logging.INFO, "fling")
    answer = service.client.get("/plans", headers={"X-Request-ID": "bug-1"})
    problem = problem_of(answer, 500, "internal")
    assert "surprise" not in str(problem)
    assert answer.headers["x-request-id"] == "bug-1"
    assert "content-security-policy" in answer.headers
    (line,) = lines_of(caplog)
    assert (line["id"], line["status"], line["problem"]) == ("bug-1", 500, "internal")
    (told,) = [orjson.loads(JsonFormatter().format(r)) for r in caplog.records if r.name == "fling"]
    assert (told["level"], told["path"], told["request_id"]) == ("error", "/plans", "bug-1")
    assert "surprise" in told["message"]
    monkeypatch.undo()
    assert 'fling_http_requests_total{method="GET",route="/plans",status="500"}' in service.client.get("/metrics").text


def test_the_server_s_own_log_is_json_too(capsys: pytest.CaptureFixture[str], service: RunningService):
    before = {name: logging.getLogger(name).handlers for name in ("fling", "uvicorn", "uvicorn.error")}
    configure_logs(requests=True)
    server_config(service.client.app, "127.0.0.1", 0)  # type: ignore[arg-type]
    logging.getLogger("uvicorn.error").error("Exception in ASGI application")
    for name, handlers in before.items():
        logging.getLogger(name).handlers = handlers
        logging.getLogger(name).propagate = True
    line = orjson.loads(capsys.readouterr().err)
    assert (line["logger"], line["message"]) == ("uvicorn.error", "Exception in ASGI application")
