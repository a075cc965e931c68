"""Every malformed request is answered with a documented problem: never a 500, never a success."""

from __future__ import annotations

import copy
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from api.http import json_body
from planner.documents import parse_json
from tests.api.conftest import JOINT, NO_ID, REQUEST, RunningService

JSON = {"Content-Type": "application/json"}
POSE = {
    "kind": "pose",
    "pose": {"position": [0.4, 0.2, 0.6], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    "twist": {"linear": [0.5, 0.0, 0.5], "angular": [0.0, 0.0, 0.0]},
}


def changed(path: str, value: Any, base: dict[str, Any] = REQUEST) -> dict[str, Any]:
    request = copy.deepcopy(base)
    *parents, last = path.split(".")
    at = request
    for name in parents:
        at = at.setdefault(name, {})
    at[last] = value
    return request


def problem_of(response: Any, status: int, name: str) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    assert problem["type"] == f"/problems/{name}"
    assert problem["status"] == status
    assert problem["title"]
    assert problem["detail"]
    assert problem["instance"].startswith("/")
    return problem


REFUSED_FIELDS = [
    ("release.positions", [0.0] * 5, "release.positions"),
    ("release.positions", [0.0] * 7, "release.positions"),
    ("release.positions", "six", "release.positions"),
    ("release.positions", ["0.0"] * 6, "release.positions[0]"),
    ("release.positions", [True] * 6, "release.positions[0]"),
    ("release.positions", None, "release.positions"),
    ("release.kind", "hurl", "release.kind"),
    ("release.velocity", [0.0] * 6, "release.velocity"),
    ("release", None, "release"),
    ("surprise", 1, "surprise"),
    ("limits.surprise", 1, "limits.surprise"),
    ("limits.velocity", 99.0, "limits.velocity[0]"),
    ("limits.velocity", [1.0] * 5, "limits.velocity"),
    ("limits.velocity", -1.0, "limits.velocity[0]"),
    ("limits.jerk", 1e5, "limits.jerk[0]"),
    ("limits.jerk", 1e9, "limits.jerk"),
    ("release.positions", [1e200] * 6, "release.positions[0]"),
    ("singularity_distance_min", 0.001, "singularity_distance_min"),
    ("start.positions", [0.0] * 3, "start.positions"),
    ("start.positions", [100.0] * 6, "start.positions[0]"),
    ("start.current", False, "start.current"),
    ("start", {}, "start"),
    ("frame", "moon", "frame"),
    ("backend", "magic", "backend"),
    ("time_limit_s", -1, "time_limit_s"),
    ("time_limit_s", 1e6, "time_limit_s"),
    ("release_window_s", 5.0, "release_window_s"),
    ("min_hit_probability", 1.5, "min_hit_probability"),
    ("min_hit_probability", 0.5, "min_hit_probability"),
    ("cell", 7, "cell"),
    ("cell", "x" * 1000, "cell"),
]


MANY = {f"{i:05d}": 1 for i in range(75_000)}
HUGE = {
    "unknown fields": ("/plan", MANY),
    "unknown fields of a part": ("/plan", {**REQUEST, "start": MANY}),
    "a hundred unknown fields": ("/plan", {**REQUEST, **{f"{i}": 1 for i in range(90)}}),
    "wrong numbers": ("/plan", changed("release.positions", ["x"] * 190_000)),
    "a long name": ("/plan", {**REQUEST, "k" * 900_000: 1}),
    "a long value": ("/plan", {**REQUEST, "backend": "r" * 900_000}),
    "unknown fields to execute": ("/execute", MANY),
    "ninety unknown fields to execute": ("/execute", {f"{i}": 1 for i in range(90)}),
    "a landing": (f"/executions/{NO_ID}/landing", {"position": ["x"] * 190_000, "std_m": 0.1}),
    "requests": ("/batches", {"requests": [{f"{i}": 1 for i in range(90)} for _ in range(900)]}),
    "axes": ("/batches", {"template": REQUEST, "grid": {f"no path {i}": {"values": [1]} for i in range(90)}}),
    "parameters": ("/plan?" + "&".join(f"q{i}=1" for i in range(6000)), REQUEST),
    "a long parameter": ("/plan?" + "q" * 60_000, REQUEST),
}


@pytest.mark.parametrize(("path", "body"), HUGE.values(), ids=HUGE)
def test_a_refusal_is_short_however_much_is_wrong(service: RunningService, path: str, body: Any):
    answer = service.client.post(path, json=body)
    problem = problem_of(answer, 422, "invalid-request")
    assert 1 <= len(problem["errors"]) <= 20
    assert len(answer.content) < 20_000


def test_the_event_loop_reads_no_large_body(service: RunningService, monkeypatch: pytest.MonkeyPatch):
    seen: list[str] = []

    def noting(body: bytes) -> Any:
        seen.append(threading.current_thread().name)
        return parse_json(body)

    monkeypatch.setattr(json_body, "parse_json", noting)
    for unknown in ("x", "x" * 30_000):
        problem_of(service.client.post("/plan", json={**REQUEST, unknown: 1}), 422, "invalid-request")
    assert "worker thread" not in seen[0]
    assert "worker thread" in seen[1]


def test_a_stop_waits_behind_nothing(service: RunningService, monkeypatch: pytest.MonkeyPatch):
    """Sixty requests wait for the store, and a large body is read; a stop is answered meanwhile."""
    go_on = threading.Event()
    monkeypatch.setattr(service.store, "plans", lambda *_: go_on.wait(60.0) and ([], None))
    monkeypatch.setattr(json_body, "parse_json", lambda _: go_on.wait(60.0))
    with ThreadPoolExecutor(64) as clients:
        waiting = [clients.submit(service.client.get, "/plans") for _ in range(60)]
        waiting.append(clients.submit(service.client.post, "/plan", json={"large": "x" * 30_000}))
        stop = clients.submit(service.client.post, f"/executions/{NO_ID}/abort")
        try:
            problem_of(stop.result(30.0), 404, "not-found")
            assert not any(answer.done() for answer in waiting)
        finally:
            go_on.set()


@pytest.mark.parametrize(("path", "value", "field"), REFUSED_FIELDS)
def test_a_wrong_field_is_named(service: RunningService, path: str, value: Any, field: str):
    problem = problem_of(service.client.post("/plan", json=changed(path, value)), 422, "invalid-request")
    assert field in [error["field"] for error in problem["errors"]], problem["errors"]
    assert all(error["reason"] for error in problem["errors"])


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize("path", ["release.positions", "limits.velocity", "time_limit_s"])
def test_nan_and_infinity_are_refused(service: RunningService, number: str, path: str):
    text = json.dumps(changed(path, "HERE" if path == "time_limit_s" else ["HERE"] + [0.1] * 5))
    response = service.client.post("/plan", content=text.replace('"HERE"', number), headers=JSON)
    assert problem_of(response, 422, "invalid-request")["errors"][0]["field"].startswith(path)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"7",
        b'"text"',
        b"\xff\xfe",
        b"[" * 100_000,
        b"9" * 5000,
        b'{"a\\ud800": 1}',
        b'{"release": "\\ud800"}',
        b'{"cell": "\\ud800"}',
    ],
)
def test_a_body_that_is_no_request_is_refused(service: RunningService, body: bytes):
    problem_of(service.client.post("/plan", content=body, headers=JSON), 422, "invalid-request")


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, 0, 2], [1, 1, 1, 1]])
def test_a_quaternion_must_have_length_one(service: RunningService, quaternion: list[float]):
    request = changed("release.pose.quaternion", quaternion, {"release": POSE})
    problem = problem_of(service.client.post("/plan", json=request), 422, "invalid-request")
    assert problem["errors"][0]["field"] == "release.pose.quaternion"


def test_two_orientations_must_agree(service: RunningService):
    request = changed("release.pose.rotation_vector", [0, 0, 0.1], {"release": POSE})
    problem = problem_of(service.client.post("/plan", json=request), 422, "invalid-request")
    assert problem["errors"][0]["field"] == "release.pose"
    assert "0.1 rad apart" in problem["detail"]
    neither = {name: value for name, value in POSE["pose"].items() if name != "quaternion"}
    problem = problem_of(
        service.client.post("/plan", json=changed("release.pose", neither, {"release": POSE})), 422, "invalid-request"
    )
    assert problem["errors"][0]["field"] == "release.pose"


def test_the_pose_of_an_answer_can_be_posted_back(service: RunningService, plan):
    release = {"kind": "pose", "pose": plan["release"]["pose"], "twist": plan["release"]["twist"]}
    again = service.plan(release=release)
    assert again["release"]["pose"]["position"] == pytest.approx(release["pose"]["position"], abs=1e-6)
    assert again["release"]["pose"]["quaternion"] == pytest.approx(release["pose"]["quaternion"], abs=1e-6)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ('{"release": {"kind": "joint"}, "frame": "base", "frame": "world"}', "frame"),
        ('{"release": {"kind": "joint", "kind": "pose"}}', "kind"),
        ('{"cell": "ur5e\\u0000sim", "release": {}}', "cell"),
        ('{"release": {"kind": ["\\ud800"]}}', "release.kind[0]"),
        ('{"release": {"\\u0000": 1}}', "release.'\\x00'"),
    ],
)
def test_json_must_mean_one_thing(service: RunningService, body: str, field: str):
    problem = problem_of(service.client.post("/plan", content=body, headers=JSON), 422, "invalid-request")
    assert field in [error["field"] for error in problem["errors"]]


@pytest.mark.parametrize("cursor", ["", "x", "01a202d3-06cc-74a0-a3cb-10a25ff26159x", "%00", "latest"])
@pytest.mark.parametrize("path", ["/plans", "/executions", "/experiments"])
def test_a_cursor_that_no_page_gave_is_refused(service: RunningService, path: str, cursor: str):
    problem = problem_of(service.client.get(f"{path}?cursor={cursor}"), 422, "invalid-request")
    assert problem["errors"][0]["field"] == "query.cursor"


@pytest.mark.parametrize("path", ["/plans/%00", "/executions/%00", "/experiments/a%00b", "/profiles/%00/adopt"])
def test_an_id_is_a_uuid_at_the_door(service: RunningService, path: str):
    method = "POST" if path.endswith("adopt") else "GET"
    problem_of(service.client.request(method, path), 404, "not-found")


def test_an_unknown_cell(service: RunningService):
    problem = problem_of(service.client.post("/plan", json={**REQUEST, "cell": "nowhere"}), 404, "not-found")
    assert "nowhere" in problem["detail"]


def test_a_cell_whose_file_is_refused(service: RunningService):
    problem = problem_of(service.client.post("/plan", json={**REQUEST, "cell": "wrong"}), 422, "invalid-request")
    assert problem["errors"][0]["field"] == "cell"
    assert "unknown_key" in problem["detail"]


@pytest.mark.parametrize("path", ["../ur5e-sim", "..%2Fur5e-sim", "a/b", "%00"])
def test_a_cell_name_is_never_a_path(service: RunningService, path: str):
    problem_of(service.client.get(f"/cells/{path}/state"), 404, "not-found")


@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_of_two_megabytes_is_refused(service: RunningService, chunked: bool):
    body = b"[" + b"0," * 1_000_000 + b"0]"
    content = iter([body[i : i + 65536] for i in range(0, len(body), 65536)]) if chunked else body
    problem_of(service.client.post("/plan", content=content, headers=JSON), 413, "too-large")


@pytest.mark.parametrize("media", ["text/plain", "application/x-www-form-urlencoded", "application/xml", ""])
def test_other_media_types_are_refused(service: RunningService, media: str):
    response = service.client.post("/plan", content=json.dumps(REQUEST), headers={"Content-Type": media})
    problem_of(response, 415, "unsupported-media-type")


@pytest.mark.parametrize(
    ("method", "path", "status", "name"),
    [
        ("PUT", "/plan", 405, "method-not-allowed"),
        ("DELETE", "/plans/x", 405, "method-not-allowed"),
        ("GET", "/nothing", 404, "not-found"),
        ("GET", "/plans/x", 404, "not-found"),
        ("GET", "/plans/x/trajectory", 404, "not-found"),
        ("GET", "/executions/x", 404, "not-found"),
        ("GET", "/executions/x/events", 404, "not-found"),
        ("GET", "/executions/x/recording", 404, "not-found"),
        ("POST", "/executions/x/abort", 404, "not-found"),
        ("POST", "/cells/x/acknowledge", 404, "not-found"),
        ("GET", "/cells/x", 404, "not-found"),
        ("GET", "/problems/x", 404, "not-found"),
        ("GET", "/web/..%2fapp.py", 404, "not-found"),
        ("GET", "/plans?limit=0", 422, "invalid-request"),
        ("GET", "/plans?limit=a", 422, "invalid-request"),
        ("GET", "/plans/", 404, "not-found"),
    ],
)
def test_wrong_addresses_are_problems_too(service: RunningService, method: str, path: str, status: int, name: str):
    problem_of(service.client.request(method, path), status, name)


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"plan_id": 7},
        {"plan_id": "x", "mode": "warp"},
        {"plan_id": "x", "dry_run": 1},
        {"plan_id": "x", "speed": 2},
    ],
)
def test_wrong_executions(service: RunningService, body: dict[str, Any]):
    problem_of(service.client.post("/execute", json=body), 422, "invalid-request")


def test_every_wrong_field_is_reported_at_once(service: RunningService):
    request = changed("frame", "moon", changed("release.positions", [0.0] * 5))
    problem = problem_of(service.client.post("/plan", json=request), 422, "invalid-request")
    assert {"frame", "release.positions"} <= {error["field"] for error in problem["errors"]}


def test_an_impossible_release_is_infeasible_in_words(service: RunningService):
    release = {**JOINT, "velocities": [9.0, 0, 0, 0, 0, 0]}
    problem = problem_of(service.client.post("/plan", json={"release": release}), 422, "infeasible")
    assert {"constraint", "value", "limit", "unit"} <= problem["violations"][0].keys()
    assert problem["violations"][0]["constraint"] == "joint_velocity"
    assert "nearest" in problem


def test_the_nearest_can_be_posted_again(service: RunningService):
    release = {**JOINT, "velocities": [9.0, 0, 0, 0, 0, 0]}
    nearest = service.client.post("/plan", json={"release": release}).json()["nearest"]
    assert service.client.post("/plan", json=nearest).status_code == 201


def test_a_bug_shows_no_stack_trace(service: RunningService, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(type(service.store), "plans", lambda *_: 1 / 0)
    response = service.client.get("/plans")
    problem_of(response, 500, "internal")
    assert "ZeroDivisionError" not in response.text
