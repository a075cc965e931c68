"""What is refused is said in plain sentences: the field, what stood there, what may, and which field was meant."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from api.http import invalid_request, translate
from api.schemas import LandingRequest
from planner.errors import InvalidProblem
from planner.request import read_request
from tests.api.conftest import JOINT, RunningService


def detail_of(body: Any) -> str:
    with pytest.raises(InvalidProblem) as refused:
        read_request(body)
    return translate(refused.value).detail


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"relaese": 1}, "relaese: there is no such field; did you mean 'release'?"),
        ({"limits": {"velocty": 1.0}}, "limits.velocty: there is no such field; did you mean 'velocity'?"),
        (
            {"release": {**JOINT, "velocites": 1}},
            "release.velocites: there is no such field; did you mean 'velocities'",
        ),
        (
            {"release": {**JOINT, "xyz": 1}},
            "release.xyz: there is no such field; there are kind, positions, ",
        ),
        (
            {"release": {**JOINT, "kind": "jont"}},
            "release.kind: 'jont' is not one of pose, point, joint, target; did you mean",
        ),
        ({"release": {"kind": None}}, "release.kind: null is not one of pose, point, joint, target"),
        ({"release": {}}, "release.kind: is missing; it says what the other fields mean"),
        ({"release": 7}, "release: must be a JSON object, not a number"),
        ({"limits": {"velocity": [1.0] * 5}}, "limits.velocity: has 5 entries; it needs 6"),
        ({"limits": {"velocity": "a"}}, "limits.velocity: must be a number, or a list of numbers; it is 'a'"),
        ({"limits": {"jerk": [1.0] * 5 + ["a"]}}, "limits.jerk[5]: must be a number; it is 'a'"),
        ({"time_limit_s": -1}, "time_limit_s: must be above 0; it is -1"),
        ({"time_limit_s": True}, "time_limit_s: must be a number; it is true"),
        ({"time_limit_s": 1e13}, "time_limit_s: must be at most 120; it is 10000000000000.0"),
        ({"frame": "wrld"}, "frame: 'wrld' is not one of world, base; did you mean 'world'?"),
        ({"start": {}}, "start: give either positions, current or execution"),
        ({"cell": "x" * 70}, "cell: has 70 characters; it may have at most 64"),
    ],
)
def test_a_refused_field(change: dict[str, Any], sentence: str):
    assert detail_of({"release": JOINT, **change}).startswith(sentence)


@pytest.mark.parametrize(
    ("body", "sentence"),
    [([21], "body: must be a JSON object, not a list"), (None, "body: must be a JSON object, not null")],
)
def test_a_body_that_is_no_object(body: Any, sentence: str):
    assert detail_of(body) == sentence


def test_a_name_is_not_shown_as_a_pattern():
    with pytest.raises(ValidationError) as refused:
        LandingRequest.model_validate({"source": "a b"})
    problem = invalid_request(refused.value.errors(), LandingRequest)
    assert problem.detail == "source: 'a b' has a character, or a length, that is not allowed"


@pytest.mark.parametrize(
    ("method", "path", "content", "sentence"),
    [
        ("POST", "/plan", b"", "body: is missing"),
        ("POST", "/plan", b'{"release": ', "body: is not JSON at character 13: expecting value"),
        ("POST", "/execute", b'{"plan_id": "7"}', "plan_id: '7' is neither a UUID nor 'latest'"),
        ("GET", "/plans?limit=0", None, "query.limit: must be at least 1; it is '0'"),
        ("GET", "/plans?limt=3", None, "query.limt: there is no such parameter; did you mean 'limit'?"),
        ("GET", "/plans?limit=3&limit=4", None, "query.limit: is given twice"),
        ("GET", "/plans?cursor=7", None, "query.cursor: '7' is not a UUID"),
        ("POST", "/plan", b'{"time_limit_s": ' + b"9" * 5000 + b"}", "body: has a number of more than 4300 digits"),
        (
            "GET",
            "/cells/ur5e-sim/map?resolution_m=nan",
            None,
            "query.resolution_m: must be a finite number; it is 'nan'",
        ),
        ("GET", "/healthz?deep=1", None, "query.deep: there is no such parameter; there is none here"),
    ],
)
def test_at_the_door(service: RunningService, method: str, path: str, content: bytes | None, sentence: str):
    response = service.client.request(method, path, content=content, headers={"Content-Type": "application/json"})
    assert (response.status_code, response.json()["detail"]) == (422, sentence)


def test_an_id_of_the_wrong_form_is_not_shown_as_a_pattern(service: RunningService):
    assert service.client.get("/plans/7").json()["detail"] == "id: '7' is neither a UUID nor 'latest'"


@pytest.mark.parametrize(("path", "methods"), [("/experiments", "GET, HEAD, POST"), ("/plan", "POST")])
def test_a_wrong_method_is_told_all_that_there_are(service: RunningService, path: str, methods: str):
    response = service.client.request("DELETE", path)
    assert (response.status_code, response.headers["allow"]) == (405, methods)
