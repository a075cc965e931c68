"""A running motion gets another target in one call, with an executor simulated by the test."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

from api.field_errors import named_as_sent
from api.http import invalid_field
from api.leads import FIRST_S, KEPT, Leads
from api.routes import plans, retarget
from api.running_motion import RunningMotion
from planner.errors import FieldError
from store import TICK_PASSED
from tests.api.conftest import JOINT, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of
from tests.api.test_executions import streaming

PATH = "/cells/ur5e-sim/retarget"
CLOCK_S = 0.05


class FakeRun(threading.Thread):
    """A run whose motion is always at the same time, and which answers requests to replace it in turn."""

    def __init__(self, service: RunningService, id: str, *answers: str) -> None:
        super().__init__(daemon=True)
        self.service = service
        self.id = id
        self.answers = list(answers)
        self.ended = threading.Event()
        service.store.add_event(id, "telemetry", {"clock_s": CLOCK_S})

    def run(self) -> None:
        store = self.service.store
        while not self.ended.wait(0.02):
            store.add_event(self.id, "telemetry", {"clock_s": CLOCK_S})
            row = store.execution(self.id)
            if row is not None and row.open_replacement is not None:
                reason = self.answers.pop(0)
                store.answer_replacement(self.id, row.open_replacement, None if reason else CLOCK_S, reason)


def called(run: FakeRun, **more: Any) -> Any:
    run.start()
    try:
        return run.service.client.post(PATH, json={"release": JOINT, "backend": "ruckig", **more})
    finally:
        run.ended.set()
        run.join()


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has every attempt begin at once: the motion is short, and a busy machine takes longer than it."""
    monkeypatch.setattr(Leads, "lead_s", lambda *_: 0.05)
    monkeypatch.setattr(retarget, "LATER", 0.0)


def test_it_is_planned_on_the_motion_and_joined(service: RunningService, executor: FakeExecutor, plan, soon):
    id = streaming(service, plan["id"])
    response = called(FakeRun(service, id, ""))
    assert response.status_code == 202, response.text
    made = response.json()
    assert made["request"]["start"]["execution"] == id
    assert made["request"]["start"]["at_s"] >= CLOCK_S + 0.05
    (answer,) = service.client.get(f"/executions/{id}").json()["replacements"]
    assert answer["plan_id"] == made["id"]


def test_a_throw_is_moved_to_the_new_target(service: RunningService, executor: FakeExecutor):
    release = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    thrown = service.plan(release=release, backend="auto")
    id = streaming(service, thrown["id"])
    start = {"execution": id, "at_s": 0.4 * thrown["release_time_s"]}
    moved = {**release, "position": [1.22, 0.28, 0.0]}
    made = service.plan(release=moved, start=start, backend="auto")
    assert [each["result"] for each in made["solver"]["attempts"]] == ["moved throw: certified"]
    again = service.plan(release=moved, start=start, backend="auto")
    assert again["trajectory"] == made["trajectory"]
    later = {**start, "at_s": 1.01 * thrown["release_time_s"]}  # the object is gone
    late = service.plan(release=moved, start=later, backend="auto")
    assert not any("moved throw" in each["result"] for each in late["solver"]["attempts"])


@pytest.mark.parametrize(
    ("tick", "passages", "is_thrown"),
    [(0, None, True), (5, None, True), (6, None, False), (2, (3, 6), False), (3, (3, 6), True), (3, (6, 8), False)],
)
def test_a_throw_is_to_come_where_nothing_else_is_to_be_passed(tick: int, passages: Any, is_thrown: bool):
    rows = np.arange(10.0)[:, None] + np.zeros(6)
    motion = {name: rows.tolist() for name in ("positions", "velocities", "accelerations")}
    told = {} if passages is None else {"passages": [{"index": index} for index in passages]}
    release = {"index": 6, "command_time_s": 0.004}
    found = RunningMotion({"release": release, "sample_rate_hz": 500.0, **told}, motion, tick)
    assert found.state["velocities"] == rows[tick].tolist()
    left = found.throw
    assert (left is not None) == is_thrown
    if left is not None:
        assert left.release_index == 6 - tick
        assert np.array_equal(left.q, rows[tick:])


def test_a_motion_that_lets_nothing_go_is_no_throw():
    motion = {name: [[0.0] * 6] * 10 for name in ("positions", "velocities", "accelerations")}
    rest = {"index": 6, "command_time_s": None}  # a move to rest
    for release, passages in ((None, [{"index": 6}]), (rest, None)):
        summary = {"release": release, "sample_rate_hz": 500.0, "passages": passages}
        assert RunningMotion(summary, motion, 2).throw is None


def test_a_tick_that_has_passed_is_tried_once_more(service: RunningService, executor: FakeExecutor, plan, soon):
    id = streaming(service, plan["id"])
    response = called(FakeRun(service, id, f"{TICK_PASSED}: 0.1 s ago", ""))
    assert response.status_code == 202, response.text
    first, second = service.client.get(f"/executions/{id}").json()["replacements"]
    assert response.json()["id"] == second["plan_id"] != first["plan_id"]


def test_not_twice_and_for_no_other_reason(service: RunningService, executor: FakeExecutor, plan, soon):
    id = streaming(service, plan["id"])
    late = f"{TICK_PASSED}: 0.1 s ago"
    assert problem_of(called(FakeRun(service, id, late, late)), 409, "cannot-join")["detail"] == late
    off = "the plan does not begin on the motion"
    assert problem_of(called(FakeRun(service, id, off)), 409, "cannot-join")["detail"] == off
    assert len(service.client.get(f"/executions/{id}").json()["replacements"]) == 3


def test_what_no_motion_can_do_and_what_is_given_are_refused(service: RunningService, executor: FakeExecutor, plan):
    idle = service.client.post(PATH, json={"release": JOINT})
    assert "there is no motion to join" in problem_of(idle, 409, "cannot-join")["detail"]
    streaming(service, plan["id"])
    for name, value in (("start", {"current": True}), ("cell", "ur5e-sim")):
        answer = problem_of(service.client.post(PATH, json={"release": JOINT, name: value}), 422, "invalid-request")
        assert answer["errors"][0]["field"] == name
    untold = problem_of(service.client.post(PATH, json={"release": JOINT}), 409, "cannot-join")
    assert "has not told yet" in untold["detail"]


def test_a_limit_below_the_running_motion_is_refused_by_its_own_field(service, executor: FakeExecutor, plan, soon):
    """The request that is built begins with the motion's speeds, which nobody sent."""
    id = streaming(service, plan["id"])
    answer = problem_of(called(FakeRun(service, id), limits={"velocity": 1e-4}), 422, "invalid-request")
    assert {each["field"] for each in answer["errors"]} == {"limits.velocity"}
    assert "to begin with: " in answer["errors"][0]["reason"]
    assert "is beyond the joint's limit of 0.0001 rad/s" in answer["errors"][0]["reason"]


def test_a_start_that_cannot_be_is_no_field_of_the_body(service, executor: FakeExecutor, plan, soon, monkeypatch):
    """As where the execution ends just then."""
    id = streaming(service, plan["id"])

    def ended(*_: Any) -> Any:
        raise invalid_field("start.execution", f"{id} has ended: no motion can begin on it")

    monkeypatch.setattr(plans, "_motion_of_execution", ended)
    answer = problem_of(called(FakeRun(service, id)), 409, "cannot-join")
    assert answer["detail"] == f"{id} has ended: no motion can begin on it"


@pytest.mark.parametrize(
    ("sent", "field", "named"),
    [
        ({"start": {"positions": [0.0] * 6}}, "start.positions[1]", "start.positions[1]"),
        ({"start": {"current": True}}, "start.positions[1]", "start.current"),
        ({"start": {"execution": "latest", "at_s": 0.1}}, "start.velocities[1]", "start.at_s"),
        ({"start": {"execution": "latest", "at_s": 0.1}, "limits": {"velocity": 1.0}}, "start.velocities[1]",
         "limits.velocity"),
        ({"start": {"execution": "latest", "at_s": 0.1}, "limits": {"velocity": 1.0}}, "start.accelerations[1]",
         "start.at_s"),
        ({"release": {"position": {"target": "a"}}}, "release.velocity", "release.position.target"),
        ({"release": {"position": {"target": "a"}}}, "release.position[2]", "release.position.target"),
        ({"release": {"position": {"target": "a"}}}, "release.position", "release.position"),
        ({"release": {"position": {"target": "a"}, "opening": {}}}, "release.opening", "release.opening"),
        ({"release": {"position": [1.0, 0.0, 0.0], "velocity": [9.0, 0.0, 0.0]}}, "release.velocity",
         "release.velocity"),
    ],
)  # fmt: skip
def test_errors_name_what_was_sent(sent: dict[str, Any], field: str, named: str):
    (found,) = named_as_sent(sent, [FieldError(field, "is wrong")])
    assert found.field == named
    assert (found.reason == "is wrong") is (field == named)
    assert found.reason.endswith("is wrong")


def test_a_motion_that_ends_before_the_tick_is_not_joined(service: RunningService, executor: FakeExecutor, plan):
    id = streaming(service, plan["id"])
    service.store.add_event(id, "telemetry", {"clock_s": 50.0})
    answer = problem_of(service.client.post(PATH, json={"release": JOINT}), 409, "cannot-join")
    assert "ends before" in answer["detail"]
    assert service.client.get(f"/executions/{id}").json()["replacements"] == []


def test_the_lead_is_enough_for_nine_in_ten_of_the_last_calls():
    leads = Leads()
    assert leads.lead_s("one") == FIRST_S
    for taken_s in range(1, KEPT + 1):
        leads.note("one", 0.01 * taken_s)
    assert leads.lead_s("one") == pytest.approx(0.18)
    assert leads.lead_s("other") == FIRST_S


def test_a_slow_call_does_not_keep_others_out():
    """Each motion that ends before the lead has the longest call forgotten."""
    leads = Leads()
    leads.note("one", 6.0)
    assert leads.lead_s("one") == 6.0
    leads.shorten("one")
    assert leads.lead_s("one") == FIRST_S
    leads.shorten("one")
    assert leads.lead_s("one") == FIRST_S


def test_a_running_motion_waits_for_no_target(service: RunningService, executor: FakeExecutor, plan):
    streaming(service, plan["id"])
    release = {"kind": "target", "position": [1.1, -0.5, 0.0], "velocity": [0.0, 0.3, 0.0], "observed_at_s": 700.0}
    answer = problem_of(service.client.post(PATH, json={"release": release}), 422, "invalid-request")
    assert "release.velocity" in str(answer)


def test_a_target_that_moves_starts_some_time_after_it_is_asked_for(service: RunningService, executor: FakeExecutor):
    release = {"kind": "target", "position": [1.1, -0.5, 0.0], "velocity": [0.0, 0.3, 0.0], "observed_at_s": 700.0}
    untold = problem_of(service.client.post("/plan", json={"release": release}), 409, "robot-not-ready")
    assert "starts_not_before_s" in untold["detail"]
    executor.robot = {**executor.robot, "timestamp_s": 700.2}
    executor.beat()
    begun_s = time.time()
    made = service.client.post("/plan", json={"release": release})
    assert made.status_code == 201, made.text
    earliest_s = made.json()["request"]["starts_not_before_s"]
    assert 702.2 <= earliest_s < 702.3 + time.time() - begun_s + 2.0
    assert made.json()["starts_at_s"] >= earliest_s


def test_without_tokens_no_real_arm_is_moved(service: RunningService) -> None:
    answer = service.client.post("/cells/real/retarget", json={"release": JOINT})
    assert "without tokens" in problem_of(answer, 403, "forbidden")["detail"]
