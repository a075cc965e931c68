"""Anything in place of any field: the answer is a plan or a problem, never a 500."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.api.conftest import JOINT, RunningService

BASE: dict[str, Any] = {
    "cell": "ur5e-sim",
    "start": {"positions": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]},
    "release": JOINT,
    "frame": "world",
    "backend": "ruckig",
    "limits": {"velocity": 2.5, "jerk": 400.0},
    "time_limit_s": 0.2,
}
PATHS = [
    ["cell"],
    ["start"],
    ["start", "positions"],
    ["start", "positions", 2],
    ["release"],
    ["release", "kind"],
    ["release", "positions"],
    ["release", "positions", 0],
    ["release", "velocities", 5],
    ["frame"],
    ["backend"],
    ["limits"],
    ["limits", "velocity"],
    ["limits", "jerk"],
    ["limits", "more"],
    ["time_limit_s"],
    ["more"],
    ["singularity_distance_min"],
    ["release_window_s"],
    ["landing_tolerance_m"],
    ["min_hit_probability"],
]
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=6), inner))


def replaced(path: list[Any], value: Any) -> dict[str, Any]:
    request = copy.deepcopy(BASE)
    at: Any = request
    for part in path[:-1]:
        at = at[part]
    at[path[-1]] = value
    return request


@pytest.mark.slow
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.sampled_from(PATHS), value=VALUES)
def test_any_value_in_any_field(service: RunningService, path: list[Any], value: Any):
    body = json.dumps(replaced(path, value))
    response = service.client.post("/plan", content=body, headers={"Content-Type": "application/json"})
    assert response.status_code in (201, 404, 422, 503), response.text
    if response.status_code != 201:
        assert response.headers["content-type"] == "application/problem+json"
        assert response.json()["status"] == response.status_code


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(body=st.binary(max_size=64))
def test_any_bytes(service: RunningService, body: bytes):
    response = service.client.post("/execute", content=body, headers={"Content-Type": "application/json"})
    assert response.status_code == 422, response.text
    assert response.headers["content-type"] == "application/problem+json"
