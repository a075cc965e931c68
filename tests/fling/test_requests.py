"""Typed requests: the fields of `POST /plan`, under the same names."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, get_args

import numpy as np
import pytest

import fling
from fling.requests import Backend, request_of
from planner.problem import BACKENDS
from planner.releases import KINDS
from planner.request import LIMITS, PLAN_REQUEST, read_request

START = [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
RELEASES = {
    "joint": fling.Joint(np.zeros(6), [0.1] * 6),
    "pose": fling.Pose([0.5, 0.2, 0.6], [1.0, 0.0, 0.5], rotation_vector=[0.0, 1.57, 0.0]),
    "point": fling.Point((0.5, 0.2, 0.6), (1.0, 0.0, 0.5)),
    "target": fling.Target(
        [1.2, 0.3, 0.0], fling.Bin(0.1, 0.05), max_release_speed_m_s=3, release_position=(0.4, 0, 1)
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_type_that_states_it(kind: str):
    stated = RELEASES[kind].as_document()
    assert stated["kind"] == kind
    read = read_request({"release": stated})["release"]
    assert {key: read[key] for key in stated} == stated


@pytest.mark.parametrize("kind", ["joint", "point", "target"])
def test_the_fields_are_those_of_the_service(kind: str):
    assert {each.name for each in fields(RELEASES[kind])} == set(KINDS[kind].record.fields)


def test_the_options_are_those_of_the_service():
    assert set(fling.Options.__annotations__) == set(PLAN_REQUEST.fields) - {"cell", "release"}
    assert set(fling.Limits.__annotations__) == set(LIMITS.fields)
    assert set(get_args(Backend)) == set(BACKENDS)


@pytest.mark.parametrize("start", [START, tuple(START), np.array(START), {"positions": START}])
def test_a_start_is_given_as_it_comes(start: Any):
    asked = request_of(RELEASES["target"], {"start": start, "backend": "ruckig"})
    assert asked["start"] == {"positions": START}
    assert fling.problem(RELEASES["target"], "ur5e-sim", start=start).start.tolist() == START


def test_a_document_takes_options_too_and_stays_as_it_is():
    document = {"release": RELEASES["point"].as_document()}
    asked = fling.problem(document, "ur5e-sim", landing_tolerance_m=0.5, release_window_s=0.004)
    assert (asked.landing_tolerance_m, asked.release_window_s) == (0.5, 0.004)
    assert list(document) == ["release"]


def test_what_is_wrong_is_named_as_by_the_service():
    with pytest.raises(fling.InvalidProblem, match=r"release\.position"):
        fling.problem(fling.Target([1.2, 0.3]), "ur5e-sim")
    with pytest.raises(fling.InvalidProblem, match=r"release\.position"):
        fling.problem(fling.Target("here"), "ur5e-sim")  # type: ignore[arg-type]
    with pytest.raises(fling.InvalidProblem, match="windows"):
        fling.problem(RELEASES["target"], "ur5e-sim", windows=3)  # type: ignore[call-arg]
    stated = fling.problem(RELEASES["target"], "ur5e-sim")
    with pytest.raises(TypeError, match=r"dataclasses\.replace"):
        fling.plan(stated, backend="ruckig")
