"""Typed requests: the fields of `POST /plan`, under the same names."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_args

import numpy as np
import pytest

import fling
from fling.requests import Backend, request_of
from planner.passages import PASSAGE, SWITCH
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


def test_passages_state_what_the_service_takes():
    edge = fling.Output("standard_digital", 2, False, offset_s=-0.01)
    throw = fling.Passage("throw", RELEASES["target"], releases=True)
    stated = request_of([fling.Passage("by", RELEASES["point"], [edge], at_s=1.5), throw], {"end": {"kind": "home"}})
    first, second = read_request(stated)["passages"]
    assert first["outputs"] == [{"output": "standard_digital", "index": 2, "level": False, "offset_s": -0.01}]
    assert (first["name"], first["at_s"], "releases" in first) == ("by", 1.5, False)
    assert (second["releases"], "at_s" in second) == (True, False)
    assert {each.name for each in fields(throw)} | {"line"} == set(PASSAGE.fields)
    assert {each.name for each in fields(edge)} == set(SWITCH.fields)


def test_lines_state_what_the_service_takes():
    valve = fling.Output("standard_digital", 2, offset_m=0.1)
    there = {"position": [0.5, 0.2, 0.3], "rotation_vector": [3.0, 0.0, 0.0]}
    for given, end in (({}, there), ({"end_quaternion": (1.0, 0.0, 0.0, 0.0)}, {"quaternion": [1.0, 0.0, 0.0, 0.0]})):
        line = fling.Line((0.5, -0.2, 0.3), (0.5, 0.2, 0.3), 0.4, rotation_vector=(3.0, 0.0, 0.0), **given)
        (bead,) = read_request(request_of([fling.Passage("bead", line, [valve])], {}))["passages"]
        assert bead["line"]["from"] == {**there, "position": [0.5, -0.2, 0.3]}
        assert bead["line"]["to"] == {"position": [0.5, 0.2, 0.3], **end} | ({} if given else there)
        assert bead["line"]["speed_m_s"] == 0.4
        assert bead["outputs"][0]["offset_m"] == 0.1
        assert "state" not in bead


def test_the_options_are_those_of_the_service():
    assert set(fling.Options.__annotations__) == set(PLAN_REQUEST.fields) - {"cell", "release", "passages"}
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


SINGLE: Any = np.float32  # what is measured or swept often comes so
WHOLE: Any = np.int64
NUMPY_RELEASES = {
    "joint": fling.Joint(np.zeros(6), [SINGLE(0.1), *[WHOLE(0)] * 5]),
    "pose": fling.Pose(np.ones(3), (SINGLE(1.0), 0, 0), quaternion=[*[WHOLE(0)] * 3, WHOLE(1)]),
    "point": fling.Point([SINGLE(0.5), 0.2, 0.6], np.ones(3)),
    "target": fling.Target([WHOLE(1), 0.3, 0], fling.Bin(SINGLE(0.12), SINGLE(0.2)), SINGLE(3.0)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_request_made_with_numpy_is_json(kind: str):
    options = {
        "limits": {"velocity": np.full(6, 2.5), "jerk": SINGLE(100.0)},
        "release_window_s": SINGLE(0.01),
        "start": {"positions": np.array(START)},
    }
    typed = request_of(NUMPY_RELEASES[kind], options)
    stated = request_of({"release": NUMPY_RELEASES[kind], **options}, {})
    assert json.loads(json.dumps(typed)) == typed == stated
    assert read_request(typed) == read_request(json.loads(json.dumps(typed)))
    assert request_of({"release": {"kind": "point", "position": np.zeros(3)}}, {})["release"]["position"] == [0.0] * 3
    json.dumps(NUMPY_RELEASES[kind].as_document())


def test_the_fields_of_a_bin_do_as_a_mapping():
    bin_around = {"radius_m": 0.12, "rim_height_m": 0.2}
    typed = fling.Target([1.2, 0.3, 0.0], fling.Bin(**bin_around))
    assert fling.Target([1.2, 0.3, 0.0], opening=bin_around).as_document() == typed.as_document()
    with pytest.raises(fling.InvalidProblem, match=r"release\.opening"):
        fling.problem(fling.Target([1.2, 0.3, 0.0], opening=0.12), "ur5e-sim")  # type: ignore[arg-type]


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
