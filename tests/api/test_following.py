"""What observations of a tracked target do to the throw at it, with an executor simulated by the test."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from api.leads import Leads
from tests.api.conftest import FakeExecutor, RunningService
from tests.api.test_targets import BIN, CAMERA, NOW_S, PATH, PLACE, STD_M, VELOCITY

FIRST = {"velocity_std_m_s": 0.004, "drift_m_s": 0.001}
FASTER_M_S = 0.018  # four deviations: 12 cm until the landing
CLOSER_M_S = 0.009


def told(after_s: float, off_m_s: float = 0.0) -> dict[str, Any]:
    """Returns what camera and encoder tell of a bin on a belt that is faster by `off_m_s` than it was at first."""
    velocity = VELOCITY + np.array([0.0, off_m_s, 0.0])
    place = (PLACE + after_s * velocity).tolist()
    encoder = {"velocity": velocity.tolist(), "velocity_std_m_s": 0.002}
    return {"position": place, "std_m": STD_M, "observed_at_s": NOW_S + after_s, **encoder}


class FakeThrow:
    """An execution of a plan to a tracked bin; the controller's time is what the test says."""

    def __init__(
        self, service: RunningService, executor: FakeExecutor, starts_in_s: float, before: tuple[Any, ...] = ()
    ) -> None:
        self.service = service
        self.executor = executor
        self.at(NOW_S + 0.1)
        first = {**told(0.0), **FIRST}
        self.target = service.client.post(PATH, json=first).json()["id"]
        release = {"kind": "target", "position": {"target": self.target}, "opening": BIN}
        passages = [*before, {"name": "throw", "state": release, "releases": True}]
        asked = {"passages": passages} if before else {"release": release}
        made = service.client.post("/plan", json={**asked, "starts_not_before_s": NOW_S + starts_in_s})
        assert made.status_code == 201, made.text
        self.plan = made.json()
        self.id = service.client.post("/execute", json={"plan_id": self.plan["id"]}).json()["id"]
        service.store.claim_execution("ur5e-sim", "fake")

    def at(self, controller_s: float) -> None:
        """Sets the controller's time."""
        self.executor.robot = {**self.executor.robot, "timestamp_s": controller_s}
        self.executor.beat()

    def observe(self, after_s: float, off_m_s: float = 0.0) -> None:
        """Posts an observation."""
        body = told(after_s, off_m_s)
        answer = self.service.client.post(f"{PATH}/{self.target}/observations", json=body)
        assert answer.status_code == 201, answer.text

    @property
    def events(self) -> list[dict[str, Any]]:
        """What was told with the execution of its target."""
        return [dict(event.data) for event in self.service.store.events(self.id) if event.kind == "target"]

    @property
    def row(self) -> Any:
        """The execution."""
        return self.service.store.execution(self.id)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has throws planned again until just before their start: a busy machine takes long."""
    monkeypatch.setattr(Leads, "lead_s", lambda *_: 0.05)


@pytest.fixture
def throw(service: RunningService, executor: FakeExecutor) -> Iterator[FakeThrow]:
    yield FakeThrow(service, executor, 6.0)
    forget(service)


@pytest.fixture
def passing(service: RunningService, executor: FakeExecutor) -> Iterator[FakeThrow]:
    """A throw after a passage."""
    yield FakeThrow(service, executor, 4.5, (CAMERA,))
    forget(service)


def forget(service: RunningService) -> None:
    service.store.close_open_executions("ur5e-sim")
    for row in service.store.targets_of_cell("ur5e-sim"):
        service.store.delete_target("ur5e-sim", row.id)


def answered(throw: FakeThrow, reason: str) -> dict[str, Any]:
    """Waits for a request to replace the plan, answers it as an executor would, and returns it."""
    until = time.monotonic() + 60.0
    while throw.row.open_replacement is None:
        assert time.monotonic() < until
        throw.at(NOW_S + 1.0)
        time.sleep(0.02)
    request = throw.row.open_replacement
    throw.service.store.answer_replacement(throw.id, request, None if reason else 0.0, reason)
    return request


def test_the_odds_are_told_of_each_observation(throw: FakeThrow) -> None:
    throw.service.store.set_state(throw.id, "approaching")
    throw.observe(0.2)
    (event,) = throw.events
    assert event["target"] == throw.target
    assert event["room_m"] == pytest.approx(BIN["radius_m"] - 0.02)
    assert event["miss_m"] < 0.2 * event["room_m"]
    assert event["hit_probability"] == pytest.approx(throw.plan["hit_probability"]["value"], abs=0.03)
    assert not event["stopped"]
    assert throw.row.replace_request is None
    streamed = throw.service.client.get(f"/executions/{throw.id}").json()
    assert streamed["outcome"] is None


def test_a_waiting_throw_is_planned_again_for_where_the_target_is_now_expected(throw: FakeThrow, soon: None) -> None:
    throw.service.store.set_state(throw.id, "approaching")
    throw.observe(0.5, CLOSER_M_S)
    request = answered(throw, "")
    made = throw.service.client.get(f"/plans/{request['plan_id']}").json()
    release = made["request"]["release"]
    assert release["tracked_target"] == throw.target
    assert release["observed_at_s"] == NOW_S + 0.5
    assert release["opening"] == throw.plan["request"]["release"]["opening"]
    assert made["request"]["starts_not_before_s"] >= throw.plan["request"]["starts_not_before_s"]
    assert {each["result"] for each in made["solver"]["attempts"]} == {"moved throw: certified"}
    np.testing.assert_allclose(made["trajectory"]["positions"][0], throw.plan["trajectory"]["positions"][0], atol=1e-12)
    throw.at(NOW_S + 1.2)
    throw.observe(1.1, CLOSER_M_S)
    assert throw.events[0]["miss_m"] > 0.2 * throw.events[0]["room_m"]
    assert throw.events[-1]["miss_m"] < 0.2 * throw.events[-1]["room_m"]  # of the new plan
    assert not throw.row.abort_requested_at


def test_a_waiting_throw_after_a_passage_is_planned_again(passing: FakeThrow, soon: None) -> None:
    passing.service.store.set_state(passing.id, "approaching")
    passing.observe(0.5, CLOSER_M_S)
    made = passing.service.client.get(f"/plans/{answered(passing, '')['plan_id']}").json()
    camera, throw = made["request"]["passages"]
    assert camera == passing.plan["request"]["passages"][0]
    assert throw["state"]["tracked_target"] == passing.target
    assert throw["state"]["observed_at_s"] == NOW_S + 0.5
    assert throw["state"]["opening"] == passing.plan["request"]["passages"][1]["state"]["opening"]
    lands_s = made["starts_at_s"] + made["release_time_s"] + made["flight"]["time_of_flight_s"]
    there = PLACE + (lands_s - NOW_S) * (VELOCITY + np.array([0.0, CLOSER_M_S, 0.0]))
    (before, *_) = [each for each in passing.events if each["miss_m"] > 0.2 * each["room_m"]]
    assert np.linalg.norm(np.array(made["flight"]["landing_point"][:2]) - there[:2]) < before["miss_m"]


@pytest.mark.parametrize("state", ["approaching", "streaming"])
def test_one_that_nobody_can_replace_any_more_is_stopped_once_it_would_miss(
    throw: FakeThrow, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    monkeypatch.setattr(Leads, "lead_s", lambda *_: 60.0)
    throw.service.store.set_state(throw.id, state)
    throw.at(NOW_S + 2.0)
    for k in range(12):
        assert throw.row.abort_requested_at is None
        throw.observe(0.5 + 0.1 * k, CLOSER_M_S + 0.002 * k)
        assert throw.events[-1]["stopped"] == (throw.events[-1]["miss_m"] > throw.events[-1]["room_m"])
        if throw.events[-1]["stopped"]:
            break
    assert k > 0  # the first one says 5 cm: the object still goes in
    assert throw.row.abort_requested_at is not None
    lines = [line for line in throw.service.store.audit_lines() if line["resource"] == f"/executions/{throw.id}"]
    assert lines[0]["action"] == "abort"
    count = len(throw.events)
    throw.observe(1.9, FASTER_M_S)
    assert len(throw.events) == count  # it is stopped already


def test_a_bin_that_is_seen_elsewhere_is_not_thrown_at(throw: FakeThrow) -> None:
    """The filter refuses what it cannot explain, and the throw is stopped all the same: the bin was moved."""
    throw.service.store.set_state(throw.id, "streaming")
    body = told(0.5)
    body["position"] = [1.6, 0.0, 0.0]
    answer = throw.service.client.post(f"{PATH}/{throw.target}/observations", json=body)
    assert answer.status_code == 422
    assert throw.events[-1]["stopped"]
    assert throw.events[-1]["hit_probability"] == 0.0
    assert throw.row.abort_requested_at is not None


def test_one_wrong_look_does_not_end_a_throw_that_still_waits(throw: FakeThrow, soon: None) -> None:
    throw.service.store.set_state(throw.id, "approaching")
    body = told(0.5)
    body["position"] = [1.6, 0.0, 0.0]
    assert throw.service.client.post(f"{PATH}/{throw.target}/observations", json=body).status_code == 422
    throw.observe(0.6)
    assert not any(each["stopped"] for each in throw.events)
    assert throw.row.replace_request is None


def test_a_throw_whose_bin_was_last_seen_elsewhere_is_stopped_before_it_begins(throw: FakeThrow, soon: None) -> None:
    throw.service.store.set_state(throw.id, "approaching")
    throw.at(throw.plan["starts_at_s"] - 1.0)
    body = told(0.5)
    body["position"] = [1.6, 0.0, 0.0]
    assert throw.service.client.post(f"{PATH}/{throw.target}/observations", json=body).status_code == 422
    assert not throw.events[-1]["stopped"]
    until = time.monotonic() + 30.0
    while throw.row.abort_requested_at is None:
        assert time.monotonic() < until
        throw.at(throw.plan["starts_at_s"] - 0.01)
        time.sleep(0.1)


def test_what_has_left_the_gripper_is_not_stopped(throw: FakeThrow) -> None:
    throw.service.store.set_state(throw.id, "streaming")
    throw.at(throw.plan["starts_at_s"] + throw.plan["release"]["command_time_s"] + 0.01)
    for k in range(12):
        throw.observe(0.5 + 0.1 * k, FASTER_M_S)
    assert throw.events[-1]["miss_m"] > throw.events[-1]["room_m"]
    assert not throw.events[-1]["stopped"]
    assert throw.row.abort_requested_at is None


def test_another_target_does_not_concern_it(throw: FakeThrow) -> None:
    throw.service.store.set_state(throw.id, "streaming")
    other = throw.service.client.post(PATH, json=told(0.0)).json()["id"]
    answer = throw.service.client.post(f"{PATH}/{other}/observations", json=told(0.5, CLOSER_M_S))
    assert answer.status_code == 201
    assert throw.events == []


def test_a_replacement_that_is_refused_leaves_the_plan_and_is_tried_again(throw: FakeThrow, soon: None) -> None:
    throw.service.store.set_state(throw.id, "approaching")
    throw.observe(0.5, CLOSER_M_S)
    first = answered(throw, "tick passed while the plan was certified")
    until = time.monotonic() + 60.0
    while throw.row.replace_request["id"] == first["id"]:
        assert time.monotonic() < until
        throw.at(NOW_S + 1.0)
        later_s = throw.events[-1]["observed_at_s"] - NOW_S + 0.001
        throw.observe(later_s, CLOSER_M_S)
        time.sleep(0.05)
    answered(throw, "")
    assert len(throw.row.joined) == 1
