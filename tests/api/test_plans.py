from __future__ import annotations

import csv
import io
import json
from concurrent.futures import ThreadPoolExecutor

import httpx2
import numpy as np
import pytest

from tests.api.conftest import REQUEST, RunningService
from tests.api.test_bad_input import problem_of

EVENTS = {"Accept": "text/event-stream"}


def test_a_plan_is_answered_stored_and_listed(service: RunningService):
    response = service.client.post("/plan", json=REQUEST)
    assert response.status_code == 201
    plan = response.json()
    assert response.headers["location"] == f"/plans/{plan['id']}"
    assert service.client.get(f"/plans/{plan['id']}").json() == plan
    assert service.client.get("/plans/latest").json() == plan
    listed = service.client.get("/plans", params={"limit": 1}).json()["plans"][0]
    assert "trajectory" not in listed
    assert {**listed, "trajectory": plan["trajectory"]} == plan


def test_the_document_is_the_contract_s(plan):
    assert list(plan) == [
        "id",
        "created_at",
        "cell",
        "cell_sha256",
        "request",
        "backend",
        "sample_rate_hz",
        "duration_s",
        "release_time_s",
        "release",
        "flight",
        "way_home",
        "certificate",
        "solver",
        "profile",
        "aim",
        "hit_probability",
        "landing_ellipse",
        "request_id",
        "cell_version",
        "trajectory",
    ]
    assert plan["certificate"]["valid"] is True
    assert plan["release_time_s"] == plan["release"]["index"] / plan["sample_rate_hz"]
    assert plan["request"]["cell"] == "ur5e-sim"
    assert list(plan["way_home"]) == ["duration_s"]
    assert plan["way_home"]["duration_s"] > 0.0
    trajectory = plan["trajectory"]
    rows = len(trajectory["time_from_start"])
    assert {len(trajectory[k]) for k in ("positions", "velocities", "accelerations")} == {rows}
    assert np.allclose(trajectory["time_from_start"], np.arange(rows) / plan["sample_rate_hz"], atol=1e-12)
    assert np.allclose(trajectory["velocities"][plan["release"]["index"]], REQUEST["release"]["velocities"], atol=1e-9)
    assert trajectory["velocities"][-1] == [0.0] * 6


def test_without_the_trajectory(service: RunningService, plan):
    short = service.client.get(f"/plans/{plan['id']}", params={"trajectory": "false"}).json()
    assert {**short, "trajectory": plan["trajectory"]} == plan
    assert "trajectory" not in service.client.post("/plan?trajectory=false", json=REQUEST).json()


def test_the_trajectory_by_itself_in_two_formats(service: RunningService, plan):
    path = f"/plans/{plan['id']}/trajectory"
    assert service.client.get(path).json() == plan["trajectory"]
    response = service.client.get(path, headers={"Accept": "text/csv"})
    assert response.headers["content-type"].startswith("text/csv")
    rows = list(csv.reader(io.StringIO(response.text)))
    assert rows[0][:2] == ["time_from_start_s", "shoulder_pan_joint_position_rad"]
    table = np.array(rows[1:], float)
    kinds = [plan["trajectory"][k] for k in ("positions", "velocities", "accelerations")]
    assert np.array_equal(table[:, 1:], np.hstack(kinds))
    assert np.array_equal(table[:, 0], plan["trajectory"]["time_from_start"])


def test_pages_of_plans_hold_each_plan_once(service: RunningService):
    made = {service.plan()["id"] for _ in range(3)}
    seen = []
    cursor = None
    while True:
        page = service.client.get("/plans", params={"limit": 2, **({"cursor": cursor} if cursor else {})}).json()
        seen += [plan["id"] for plan in page["plans"]]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert made <= set(seen)
    assert len(seen) == len(set(seen))
    assert seen == sorted(seen, reverse=True)


def test_the_same_key_and_body_give_the_same_plan(service: RunningService):
    headers = {"Idempotency-Key": "same"}
    first = service.client.post("/plan", json=REQUEST, headers=headers)
    again = service.client.post("/plan", json=REQUEST, headers=headers)
    assert (again.status_code, again.json()) == (201, first.json())
    other = service.client.post("/plan", json={**REQUEST, "time_limit_s": 4.0}, headers=headers)
    problem_of(other, 422, "idempotency-conflict")


def test_the_same_key_twice_at_once_gives_one_plan(service: RunningService):
    def post(_: int) -> str:
        return service.client.post("/plan", json=REQUEST, headers={"Idempotency-Key": "race"}).json()["id"]

    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(post, range(4)))) == 1


def test_a_key_may_not_be_endless(service: RunningService):
    response = service.client.post("/plan", json=REQUEST, headers={"Idempotency-Key": "k" * 300})
    assert problem_of(response, 422, "invalid-request")["errors"][0]["field"] == "Idempotency-Key"


def test_a_plan_may_start_at_the_current_position(service: RunningService, executor):
    plan = service.plan(start={"current": True})
    assert plan["request"]["start"] == {"positions": executor.robot["positions"]}
    assert plan["trajectory"]["positions"][0] == executor.robot["positions"]


def test_an_unknown_current_position_is_refused(service: RunningService):
    response = service.client.post("/plan", json={**REQUEST, "cell": "changing", "start": {"current": True}})
    problem_of(response, 409, "robot-not-ready")


def test_the_base_frame(service: RunningService):
    release = {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.6]}
    world, base = (
        service.plan(release=release, frame=frame)["release"]["pose"]["position"] for frame in ("world", "base")
    )
    assert np.allclose(world, base, atol=1e-9)  # this cell's base is the world's origin


def test_a_plan_that_is_not_stored(service: RunningService):
    before = service.client.get("/plans", params={"limit": 1}).json()["plans"]
    response = service.client.post("/plan?store=false", json=REQUEST)
    assert response.status_code == 200
    assert "location" not in response.headers
    answer = response.json()
    assert "id" not in answer
    assert answer["certificate"]["valid"] is True
    assert len(answer["trajectory"]["positions"]) == round(answer["duration_s"] * answer["sample_rate_hz"]) + 1
    assert "trajectory" not in service.client.post("/plan?store=false&trajectory=false", json=REQUEST).json()
    assert service.client.get("/plans", params={"limit": 1}).json()["plans"] == before
    keyed = service.client.post("/plan?store=false", json=REQUEST, headers={"Idempotency-Key": "none"})
    assert problem_of(keyed, 422, "invalid-request")["errors"][0]["field"] == "Idempotency-Key"


def events_of(response: httpx2.Response) -> list[tuple[str, dict]]:
    """Returns kind and data of each event of an answer."""
    assert (response.status_code, response.headers["content-type"].split(";")[0]) == (200, "text/event-stream")
    blocks = [dict(line.split(": ", 1) for line in block.splitlines()) for block in response.text.split("\n\n")[:-1]]
    assert [int(block["id"]) for block in blocks] == list(range(1, len(blocks) + 1))
    return [(block["event"], json.loads(block["data"])) for block in blocks]


def test_a_plan_as_events_ends_with_the_plan(service: RunningService):
    *progress, (kind, plan) = events_of(service.client.post("/plan", json=REQUEST, headers=EVENTS))
    assert kind == "plan"
    assert service.client.get(f"/plans/{plan['id']}").json() == plan
    assert progress[0][1] | {"elapsed_s": 0.0} == {
        "stage": "queued", "candidates": 0, "best_release_time_s": None, "elapsed_s": 0.0,
    }  # fmt: skip
    assert {kind for kind, _ in progress} == {"progress"}
    preview = events_of(service.client.post("/plan?store=false&trajectory=false", json=REQUEST, headers=EVENTS))[-1][1]
    assert not {"id", "trajectory"} & preview.keys()


def test_a_search_as_events_tells_what_it_tries_and_ends_with_the_problem(service: RunningService):
    asked = {"release": {"kind": "point", "position": [0.9, 0.0, 0.5], "velocity": [2.9, 0.0, 2.0]}}
    *progress, (kind, problem) = events_of(service.client.post("/plan", json=asked, headers=EVENTS))
    assert (kind, problem["type"], problem["status"]) == ("problem", "/problems/infeasible", 422)
    assert progress[-1][1]["candidates"] > 0
    unknown = events_of(service.client.post("/plan", json={**REQUEST, "cell": "nowhere"}, headers=EVENTS))[-1]
    assert (unknown[0], unknown[1]["type"], unknown[1]["instance"]) == ("problem", "/problems/not-found", "/plan")


@pytest.mark.parametrize(("accept", "answered"), [("*/*", 201), ("text/event-stream;q=0.5, application/json", 201)])
def test_a_plan_is_json_unless_events_are_preferred(service: RunningService, accept: str, answered: int):
    assert service.client.post("/plan", json=REQUEST, headers={"Accept": accept}).status_code == answered
    problem_of(service.client.post("/plan", json=REQUEST, headers={"Accept": "text/csv"}), 406, "not-acceptable")
