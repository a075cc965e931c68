"""Operating a robot over HTTP and by the command line: asked of the executor, audited, told."""

from __future__ import annotations

import threading

import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.support.client import ServiceClient
from executor.robot import PENDANT
from tests.api.conftest import FakeExecutor, RunningService, beat_as
from tests.api.test_bad_input import problem_of

CELL = "ur5e-sim"
PATH = f"/cells/{CELL}/robot"


def test_a_request_waits_for_the_executor_and_is_audited(service: RunningService, executor: FakeExecutor) -> None:
    answer = service.client.post(PATH, json={"action": "power_on"})
    asked = answer.json()
    assert (answer.status_code, asked["action"], asked["state"], asked["text"]) == (202, "power_on", "waiting", "")
    line = service.store.audit_lines(1)[0]
    assert (line["action"], line["resource"], line["who"]) == ("robot power_on", f"/cells/{CELL}", "local")
    service.store.answer_robot_request(CELL, asked["id"], False, "the dashboard refuses it: no")
    told = service.client.get(f"/cells/{CELL}/state").json()["robot_request"]
    assert told == {**asked, "state": "refused", "text": "the dashboard refuses it: no"}


@pytest.mark.parametrize("action", [*PENDANT])
def test_every_action_of_the_executor_can_be_asked_for(
    service: RunningService, executor: FakeExecutor, action: str
) -> None:
    assert service.client.post(PATH, json={"action": action}).status_code == 202


@pytest.mark.parametrize("body", [{}, {"action": "dance"}, {"action": "power_on", "now": True}, []])
def test_another_action_is_refused(service: RunningService, executor: FakeExecutor, body: object) -> None:
    before = service.store.cell_status(CELL).robot_request
    problem_of(service.client.post(PATH, json=body), 422, "invalid-request")
    assert service.store.cell_status(CELL).robot_request == before


def test_without_an_executor_nothing_is_asked(service: RunningService) -> None:
    problem_of(service.client.post("/cells/changing/robot", json={"action": "power_on"}), 409, "robot-not-ready")
    problem_of(service.client.post("/cells/nowhere/robot", json={"action": "power_on"}), 404, "not-found")


def test_a_read_only_executor_is_not_asked(service: RunningService, executor: FakeExecutor) -> None:
    held = service.store.cell_status(CELL)
    service.store.record_heartbeat(CELL, held.executor_id, "sim", {}, None, read_only=True)
    problem_of(service.client.post(PATH, json={"action": "power_on"}), 409, "robot-not-ready")


def test_a_robot_that_runs_an_execution_is_left_alone(service: RunningService, executor: FakeExecutor, plan) -> None:
    service.store.queue_execution(plan["id"], CELL)
    problem_of(service.client.post(PATH, json={"action": "power_off"}), 409, "robot-busy")


def test_a_real_arm_is_operated_with_tokens_alone(service: RunningService) -> None:
    beat_as(service.store, "fake", "real", "ur")
    problem_of(service.client.post("/cells/real/robot", json={"action": "power_on"}), 403, "forbidden")


@pytest.mark.parametrize(
    ("done", "text", "status", "said"),
    [
        (True, "by the Robot API", 0, f"{CELL}: unlock done, by the Robot API"),
        (False, "on the pendant: look for the cause", 1, "on the pendant: look for the cause"),
    ],
)
def test_the_command_tells_what_became_of_it(
    service: RunningService,
    executor: FakeExecutor,
    monkeypatch: pytest.MonkeyPatch,
    done: bool,
    text: str,
    status: int,
    said: str,
) -> None:
    monkeypatch.setattr(ServiceClient, "get", lambda _, path: service.client.get(path).json())
    monkeypatch.setattr(ServiceClient, "post", lambda _, path, body: service.client.post(path, json=body).json())
    ended = threading.Event()

    def answer() -> None:
        while not ended.wait(0.01):
            asked = service.store.cell_status(CELL).open_robot_request
            if asked is not None and asked["action"] == "unlock_protective_stop":
                service.store.answer_robot_request(CELL, asked["id"], done, text)

    thread = threading.Thread(target=answer)
    thread.start()
    result = CliRunner().invoke(main, ["robot", "unlock", "--cell", CELL])
    ended.set()
    thread.join()
    assert (result.exit_code, said in result.output) == (status, True), result.output
