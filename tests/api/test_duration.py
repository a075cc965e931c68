"""A motion that is too long is refused by field, before it costs time or memory."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jobs.planning.duration import MOTION_MAX_S, check_duration, check_limits
from planner.cell import load_cell
from planner.errors import InvalidProblem
from planner.request import problem_from_request
from tests.api.conftest import JOINT, RunningService
from tests.api.test_bad_input import problem_of

CELL = load_cell(Path(__file__).parents[2] / "cells" / "ur5e-sim.toml")
REST = {**JOINT, "velocities": [0.0] * 6}


def problem(**limits: float):
    return problem_from_request({"cell": "ur5e-sim", "release": REST, "limits": limits}, CELL)


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
def test_a_limit_that_costs_too_long_is_named_with_value_and_time(name: str):
    travel = float(np.abs(problem().release.q - problem().start).max())
    power = {"velocity": 1, "acceleration": 2, "jerk": 3}[name]
    least = {1: travel / MOTION_MAX_S, 2: 2.0 * travel / MOTION_MAX_S**2, 3: 6.0 * travel / MOTION_MAX_S**3}[power]
    check_limits(problem(**{name: 1.01 * least}))
    with pytest.raises(InvalidProblem) as caught:
        check_limits(problem(**{name: 0.99 * least}))
    (error,) = caught.value.errors
    assert error.field == f"limits.{name}"
    assert f"{MOTION_MAX_S:g} s" in error.reason


@pytest.mark.parametrize("value", [1e-300, 1e-310])
def test_the_time_of_a_limit_near_zero_is_short_to_read(value: float):
    with pytest.raises(InvalidProblem, match=r"needs at least (\d(\.\d+)?e\+\d+|inf) s"):
        check_limits(problem(velocity=value))


def test_elevations_that_exclude_each_other_are_both_told():
    release = {"kind": "target", "position": [1.2, 0.3, 0.0], "min_elevation_rad": 1.0, "max_elevation_rad": 0.5}
    with pytest.raises(InvalidProblem, match=r"is 1, above max_elevation_rad, 0\.5"):
        problem_from_request({"release": release}, CELL)


def test_what_was_planned_is_checked_too():
    check_duration(problem(), SimpleNamespace(duration_s=MOTION_MAX_S))  # type: ignore[arg-type]
    with pytest.raises(InvalidProblem, match="61 s"):
        check_duration(problem(), SimpleNamespace(duration_s=61.0))  # type: ignore[arg-type]


def test_the_service_refuses_it_by_field(service: RunningService):
    response = service.client.post("/plan", json={"release": REST, "limits": {"velocity": 1e-4}})
    assert problem_of(response, 422, "invalid-request")["errors"][0]["field"] == "limits.velocity"
