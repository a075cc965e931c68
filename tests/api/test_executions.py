from __future__ import annotations

import json
import threading
import time
from typing import Any

import pytest

from store import pack_samples
from tests.api.conftest import NO_ID, FakeExecutor, RunningService, beat_as
from tests.api.test_bad_input import problem_of
from tests.waiting import until


def execute(service: RunningService, plan_id: str, **body: Any) -> Any:
    return service.client.post("/execute", json={"plan_id": plan_id, **body})


def events_of(text: str) -> list[dict[str, Any]]:
    found = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if "data" in fields:
            found.append({"id": int(fields["id"]), "kind": fields["event"], **json.loads(fields["data"])})
    return found


def test_an_execution_from_queue_to_metrics(service: RunningService, executor: FakeExecutor, plan):
    response = execute(service, plan["id"], mode="servoj", dry_run=True)
    assert response.status_code == 202
    row = response.json()
    assert response.headers["location"] == f"/executions/{row['id']}"
    assert (row["state"], row["outcome"], row["mode"], row["dry_run"]) == ("queued", None, "servoj", True)
    claimed = service.store.claim_execution("ur5e-sim", "fake")
    assert claimed is not None
    service.store.finish_execution(row["id"], "completed", None, {"landing_error_m": 0.001})
    finished = service.client.get(f"/executions/{row['id']}").json()
    assert (finished["state"], finished["outcome"]) == ("finished", "completed")
    assert finished["metrics"] == {"landing_error_m": 0.001}
    assert finished["finished_at"].endswith("Z")
    assert service.client.get("/executions/latest").json() == finished
    assert service.client.get("/executions").json()["executions"][0] == finished


def test_a_motion_may_run_inside_the_controller(service: RunningService, executor: FakeExecutor, plan):
    assert execute(service, plan["id"], mode="script").json()["mode"] == "script"


def test_a_cell_runs_one_execution_at_a_time(service: RunningService, executor: FakeExecutor, plan):
    assert execute(service, plan["id"]).status_code == 202
    assert problem_of(execute(service, plan["id"]), 409, "robot-busy")["cell"] == "ur5e-sim"


def test_the_same_key_is_one_motion(service: RunningService, executor: FakeExecutor, plan):
    body = {"plan_id": plan["id"]}
    headers = {"Idempotency-Key": "one"}
    first = service.client.post("/execute", json=body, headers=headers)
    again = service.client.post("/execute", json=body, headers=headers)
    assert (again.status_code, again.json()["id"]) == (202, first.json()["id"])
    other = service.client.post("/execute", json={**body, "dry_run": True}, headers=headers)
    problem_of(other, 422, "idempotency-conflict")


def test_a_cell_without_an_executor_is_not_ready(service: RunningService, plan):
    assert (
        "no executor"
        in problem_of(execute(service, service.plan(cell="changing")["id"]), 409, "robot-not-ready")["detail"]
    )
    problem_of(execute(service, NO_ID), 404, "not-found")
    assert problem_of(execute(service, "nothing"), 422, "invalid-request")["errors"][0]["field"] == "plan_id"


def test_an_executor_without_heartbeats_is_not_ready(service: RunningService, plan, monkeypatch: pytest.MonkeyPatch):
    beat_as(service.store, "fake")
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 10.0)
    detail = problem_of(execute(service, plan["id"]), 409, "robot-not-ready")["detail"]
    assert "has not reported for 10 s: it has ended, or is stalled" in detail
    assert service.client.get("/cells/ur5e-sim/state").json()["not_executable"] == detail


def test_a_fault_must_be_acknowledged(service: RunningService, executor: FakeExecutor, plan):
    executor.fault = {"reason": "tracking", "detail": "0.1 rad off"}
    executor.beat()
    assert "tracking" in problem_of(execute(service, plan["id"]), 409, "robot-not-ready")["detail"]
    assert service.client.get("/cells/ur5e-sim/state").json()["fault"] == executor.fault
    answer = service.client.post("/cells/ur5e-sim/acknowledge")
    assert (answer.status_code, answer.json()["fault"]) == (200, executor.fault)
    assert service.store.acknowledge_requested("ur5e-sim")
    assert service.store.audit_lines(1)[0]["action"] == "acknowledge"


def test_a_cell_says_before_anyone_asks_why_it_would_not_execute(service: RunningService, executor: FakeExecutor):
    def reason(cell: str = "ur5e-sim") -> str | None:
        return service.client.get(f"/cells/{cell}/state").json()["not_executable"]

    assert reason() is None
    assert "no executor" in (reason("changing") or "")
    assert reason("real") == "a service without tokens executes on simulated cells only"
    executor.fault = {"reason": "tracking", "detail": "0.1 rad off"}
    executor.beat()
    assert "a fault is latched: tracking" in (reason() or "")
    summaries = {row["name"]: row["link_host"] for row in service.client.get("/cells").json()["cells"]}
    assert summaries["ur5e-sim"] == "127.0.0.1"


def test_executions_are_listed_by_cell_and_outcome(service: RunningService, plan):
    other = service.plan(cell="changing")
    ids = {}
    for made, outcome in ((plan, "held"), (other, "completed"), (plan, "completed")):
        row = service.store.queue_execution(made["id"], made["cell"])
        service.store.claim_execution(made["cell"], "fake")
        service.store.finish_execution(row.id, outcome)
        ids[made["cell"], outcome] = row.id

    def listed(query: str) -> list[str]:
        return [row["id"] for row in service.client.get(f"/executions?{query}").json()["executions"]]

    assert listed("cell=changing&limit=1") == [ids["changing", "completed"]]
    assert listed("cell=ur5e-sim&limit=2") == [ids["ur5e-sim", "completed"], ids["ur5e-sim", "held"]]
    assert listed("cell=ur5e-sim&outcome=held&limit=1") == [ids["ur5e-sim", "held"]]
    page = service.client.get("/executions?cell=ur5e-sim&limit=1").json()
    assert listed(f"cell=ur5e-sim&limit=1&cursor={page['next_cursor']}") == [ids["ur5e-sim", "held"]]
    problem_of(service.client.get("/executions?outcome=lost"), 422, "invalid-request")
    problem_of(service.client.get("/executions?limit=5.0"), 422, "invalid-request")
    problem_of(service.client.get("/executions?cell=%00"), 422, "invalid-request")  # PostgreSQL knows no such text


def test_a_read_only_executor_is_not_ready(service: RunningService, executor: FakeExecutor, plan):
    executor.read_only = True
    executor.beat()
    assert "read-only" in problem_of(execute(service, plan["id"]), 409, "robot-not-ready")["detail"]


def test_a_cell_that_changed_since(service: RunningService, cells):
    plan = service.plan(cell="changing")
    file = cells / "changing.toml"
    before = file.read_text()
    file.write_text(before + "# moved the table\n")
    problem_of(execute(service, plan["id"]), 409, "plan-not-executable")
    file.unlink()
    problem_of(execute(service, plan["id"]), 409, "plan-not-executable")
    file.write_text(before)


def test_without_tokens_no_real_arm_moves(service: RunningService):
    problem_of(execute(service, service.plan(cell="real")["id"]), 403, "forbidden")


def test_abort_is_a_request_that_may_be_repeated(service: RunningService, executor: FakeExecutor, plan):
    id = execute(service, plan["id"]).json()["id"]
    service.store.claim_execution("ur5e-sim", "fake")
    for _ in range(2):
        response = service.client.post(f"/executions/{id}/abort")
        assert response.status_code == 202
        assert response.json()["abort_requested_at"]
    assert service.store.abort_requested(id)
    assert [line["action"] for line in service.store.audit_lines(3)] == ["abort", "abort", "execute"]


def test_abort_of_an_unclaimed_execution_ends_it(service: RunningService, executor: FakeExecutor, plan):
    execute(service, plan["id"])
    assert service.client.post("/executions/latest/abort").json()["outcome"] == "aborted"
    assert execute(service, plan["id"]).status_code == 202


def test_events_come_as_they_happen_and_end_with_the_execution(service: RunningService, executor: FakeExecutor, plan):
    id = execute(service, plan["id"]).json()["id"]

    def play() -> None:
        service.store.claim_execution("ur5e-sim", "fake")
        service.store.set_state(id, "streaming")
        for k in range(5):
            service.store.add_event(id, "telemetry", {"clock_s": 0.04 * k})
        service.store.finish_execution(id, "completed", None, {"ticks": 5})

    thread = threading.Thread(target=play)
    thread.start()
    response = service.client.get(f"/executions/{id}/events")
    thread.join()
    assert response.headers["content-type"].startswith("text/event-stream")
    events = events_of(response.text)
    assert [e["state"] for e in events if e["kind"] == "state"] == ["queued", "preparing", "streaming", "finished"]
    assert [e["clock_s"] for e in events if e["kind"] == "telemetry"] == [0.04 * k for k in range(5)]
    assert events[-1]["outcome"] == "completed"
    assert events[-1]["metrics"] == {"ticks": 5}


def test_events_resume_after_the_last_one_seen(service: RunningService, executor: FakeExecutor, plan):
    id = execute(service, plan["id"]).json()["id"]
    service.store.finish_execution(id, "completed")
    path = f"/executions/{id}/events"
    everything = events_of(service.client.get(path).text)
    rest = events_of(service.client.get(path, headers={"Last-Event-ID": str(everything[0]["id"])}).text)
    assert rest == everything[1:]
    assert events_of(service.client.get(path, headers={"Last-Event-ID": str(everything[-1]["id"])}).text) == []
    for wrong in ("yesterday", "+0.0", "1_0"):
        problem_of(service.client.get(path, headers={"Last-Event-ID": wrong}), 422, "invalid-request")


def test_the_recording_in_two_formats(service: RunningService, executor: FakeExecutor, plan):
    id = execute(service, plan["id"]).json()["id"]
    path = f"/executions/{id}/recording"
    problem_of(service.client.get(path), 404, "not-found")
    service.store.add_recording(id, b"\x89MCAP0\r\n", pack_samples(["t"], [[0.0]]))
    assert service.client.get(path).content == b"\x89MCAP0\r\n"
    assert service.client.get(path, headers={"Accept": "text/csv"}).text == "t\n0.0\n"


def test_an_execution_whose_executor_is_gone_says_so(
    service: RunningService, executor: FakeExecutor, plan, monkeypatch: pytest.MonkeyPatch
):
    id = execute(service, plan["id"]).json()["id"]
    service.store.claim_execution("ur5e-sim", "fake")
    assert service.client.get(f"/executions/{id}").json()["executor_lost"] is False
    executor.stop()
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 10.0)
    assert service.client.get(f"/executions/{id}").json()["executor_lost"] is True
    assert service.client.get("/executions").json()["executions"][0]["executor_lost"] is True
    problem = problem_of(service.client.post(f"/executions/{id}/abort"), 409, "executor-lost")
    assert (problem["execution_id"], problem["cell"]) == (id, "ur5e-sim")
    assert service.store.abort_requested(id)  # kept for an executor that was only silent
    beat_as(service.store, "fake")
    assert service.client.post(f"/executions/{id}/abort").status_code == 202
    beat_as(service.store, "another")
    problem_of(service.client.post(f"/executions/{id}/abort"), 409, "executor-lost")
    service.store.finish_execution(id, "executor_lost")
    assert service.client.get(f"/executions/{id}").json()["executor_lost"] is False
    assert service.client.post(f"/executions/{id}/abort").status_code == 202


def start_at(plan: dict[str, Any], tick: int) -> dict[str, Any]:
    motion = plan["trajectory"]
    return {name: motion[name][tick] for name in ("positions", "velocities", "accelerations")}


def replaced(service: RunningService, id: str, plan_id: str, answer: tuple[float | None, str] | None) -> Any:
    """Asks for a replacement, to which an executor gives an answer."""

    def answers() -> None:
        until(lambda: (row := service.store.execution(id)) is not None and row.open_replacement is not None)
        if answer is None:
            service.store.finish_execution(id, "completed")
        else:
            row = service.store.execution(id)
            assert row is not None
            service.store.answer_replacement(id, row.open_replacement, *answer)

    thread = threading.Thread(target=answers)
    thread.start()
    response = service.client.post(f"/executions/{id}/replace", json={"plan_id": plan_id})
    thread.join()
    return response


def streaming(service: RunningService, plan_id: str) -> str:
    id = execute(service, plan_id).json()["id"]
    service.store.claim_execution("ur5e-sim", "fake")
    service.store.set_state(id, "streaming")
    return id


def test_a_plan_begins_on_a_running_execution_and_replaces_it(service: RunningService, executor: FakeExecutor, plan):
    whole = service.client.get(f"/plans/{plan['id']}").json()
    id = streaming(service, plan["id"])
    at_s = 20 / whole["sample_rate_hz"]
    body = {"release": whole["request"]["release"], "start": {"execution": "latest", "at_s": at_s + 1e-4}}
    onward = service.client.post("/plan", json=body).json()
    assert start_at(onward, 0) == start_at(whole, 20)
    assert onward["request"]["start"] == {**start_at(whole, 20), "execution": id, "at_s": at_s + 1e-4}
    assert problem_of(execute(service, onward["id"]), 409, "plan-not-executable")["detail"].startswith(
        "the plan starts"
    )
    response = replaced(service, id, onward["id"], (at_s, ""))
    assert response.status_code == 202
    (found,) = response.json()["replacements"]
    assert (found["plan_id"], found["joins_s"], found["reason"]) == (onward["id"], at_s, "")
    later = {**body, "start": {"execution": id, "at_s": at_s + 10 / whole["sample_rate_hz"]}}
    assert start_at(service.client.post("/plan", json=later).json(), 0) == start_at(onward, 10)
    gone = {**body, "start": {"execution": id, "at_s": 50.0}}
    (error,) = problem_of(service.client.post("/plan", json=gone), 422, "invalid-request")["errors"]
    assert (error["field"], error["reason"]) == ("start.at_s", "50 s is after the end of the motion")


def test_what_cannot_join_says_why(service: RunningService, executor: FakeExecutor, plan):
    id = streaming(service, plan["id"])
    refused = replaced(service, id, plan["id"], (None, "tick passed: it begins 0.2 s ago"))
    assert problem_of(refused, 409, "cannot-join")["detail"] == "tick passed: it begins 0.2 s ago"
    assert service.client.get(f"/executions/{id}").json()["replacements"][0]["joins_s"] is None
    assert problem_of(replaced(service, id, plan["id"], None), 409, "cannot-join")["detail"].startswith("the execution")
    over = service.client.post(f"/executions/{id}/replace", json={"plan_id": plan["id"]})
    assert "there is no motion to join" in problem_of(over, 409, "cannot-join")["detail"]
    body = {"release": plan["request"]["release"], "start": {"execution": id, "at_s": 0.1}}
    (error,) = problem_of(service.client.post("/plan", json=body), 422, "invalid-request")["errors"]
    assert error["field"] == "start.execution"
    unknown = service.client.post(f"/executions/{NO_ID}/replace", json={"plan_id": plan["id"]})
    problem_of(unknown, 404, "not-found")


def test_one_replacement_at_a_time(service: RunningService, executor: FakeExecutor, plan):
    id = streaming(service, plan["id"])
    assert service.store.request_replacement(id, plan["id"], "one") is not None
    busy = service.client.post(f"/executions/{id}/replace", json={"plan_id": plan["id"]})
    assert "another plan" in problem_of(busy, 409, "cannot-join")["detail"]
