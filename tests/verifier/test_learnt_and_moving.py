"""Certified throws of learnt cells and at targets that move are proven; those with a fault are not."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from learning import cell_with_profile
from planner.answer import aimed_problem, plan_document
from planner.cell import Cell
from planner.planning import SearchHints, plan
from planner.request import problem_from_request
from tests.planner import problems
from verifier import NotAPlan, Status, verify

QUICK = SearchHints(offers_nearest=False)
BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
SHIFT = [0.02, -0.01, 0.0]
PROFILE = {
    "id": "p1",
    "cell_sha256": problems.cell().sha256,
    "lag_s": 0.03,
    "delay_s": 0.04,
    "jitter_s": 0.001,
    "speed_factor": 0.96,
    "drag_coefficient": 0.4,
    "outputs": {},
}
ACROSS = {
    "kind": "target",
    "position": [1.1, -0.5, 0.0],
    "velocity": [0.0, 0.4, 0.0],
    "observed_at_s": 1000.0,
    "opening": BIN,
}
LEARNT: dict[str, Any] = {"release": {"kind": "target", "position": [1.1, 0.3, 0.0], "opening": BIN}}
MOVING: dict[str, Any] = {"release": ACROSS, "starts_not_before_s": 1000.5, "release_window_s": 0.004}
Fault = Callable[[dict[str, Any], dict[str, Any]], Any]


@cache
def planned(name: str) -> tuple[dict[str, Any], Cell, dict[str, Any] | None]:
    """Documents of plans with their cell, as its file says, and their profile."""
    cell = problems.cell()
    if name == "moving":
        return plan_document(plan(problem_from_request(MOVING, cell), QUICK), MOVING, "", ""), cell, None
    problem = aimed_problem(problem_from_request(LEARNT, cell_with_profile(cell, PROFILE)), np.array(SHIFT))
    document = plan_document(plan(problem, QUICK), LEARNT, "", "")
    return document | {"profile": "p1", "aim": {"shift_m": SHIFT}}, cell, PROFILE


@pytest.mark.parametrize("name", ["learnt", "moving"])
def test_a_certified_throw_is_proven(name: str):
    document, cell, profile = planned(name)
    verdict = verify(document, cell, profile)
    assert verdict.status is Status.PROVEN, list(map(str, verdict.open))
    certified = {check["name"] for check in document["certificate"]["checks"]}
    assert certified <= {finding.name for finding in verdict.findings}


def test_how_far_a_learnt_throw_is_aimed_beside_its_target_is_told():
    document, cell, profile = planned("learnt")
    told = [each.detail for each in verify(document, cell, profile).findings if each.name == "landing"]
    assert told == ["aimed 0.0224 m beside the target"]


FAULTS: dict[str, tuple[str, str, Fault]] = {
    "object faster": ("learnt", "landing", lambda _, p: p.update(speed_factor=1.01 * p["speed_factor"])),
    "more drag": ("learnt", "landing", lambda _, p: p.update(drag_coefficient=0.5)),
    "more jitter": ("learnt", "landing_window", lambda _, p: p.update(jitter_s=0.006)),
    "aim off": ("learnt", "landing", lambda d, _: d["aim"].update(shift_m=[0.021, -0.01, 0.0])),
    "target off": ("learnt", "landing", lambda d, _: d["request"]["release"].update(position=[1.101, 0.3, 0.0])),
    "not aimed": ("learnt", "landing", lambda d, _: d.update(aim=None)),
    "moving target off": ("moving", "landing", lambda d, _: d["request"]["release"].update(position=[1.1, -0.501, 0])),
    "started late": ("moving", "landing", lambda d, _: d.update(starts_at_s=d["starts_at_s"] + 0.0025)),
    "target faster": ("moving", "landing", lambda d, _: d["request"]["release"].update(velocity=[0.0, 0.404, 0.0])),
    "target stands": ("moving", "landing", lambda d, _: d["request"]["release"].pop("velocity")),
    "too early": ("moving", "start", lambda d, _: d["request"].update(starts_not_before_s=d["starts_at_s"] + 0.002)),
    "a bin as high as the flight": (
        "moving",
        "flight_clearance",
        lambda d, _: d["request"]["release"].update(opening={**BIN, "rim_height_m": 0.45}),
    ),
    "a bin in which the arm is": (
        "moving",
        "keep_out",
        lambda d, _: d["request"]["release"].update(opening={"radius_m": 0.9, "rim_height_m": 0.6}),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_not_proven(fault: str):
    name, check, change = FAULTS[fault]
    document, cell, profile = planned(name)
    document = {**copy.deepcopy({k: v for k, v in document.items() if k != "trajectory"})} | {
        "trajectory": document["trajectory"]
    }
    profile = copy.deepcopy(profile)
    change(document, profile or {})
    assert check in {each.name for each in verify(document, cell, profile).open}


def test_a_bin_that_moves_is_met_at_its_rim_where_it_is_then():
    """Its wall as near to the nominal flight at the rim as the object's radius, less a millimetre."""
    document, cell, _ = planned("moving")
    assert cell.object.drag_coefficient == 0.0
    release = document["release"]
    p, v = np.array(release["pose"]["position"]), np.array(release["twist"]["linear"])
    g = cell.surroundings.gravity_m_s2
    t = (v[2] + np.sqrt(v[2] ** 2 + 2.0 * g * (p[2] - BIN["rim_height_m"]))) / g
    at_s = document["starts_at_s"] + document["release_time_s"] + t
    axis = np.array(ACROSS["position"]) + (at_s - 1000.0) * np.array(ACROSS["velocity"])
    off_m = float(np.linalg.norm((p + v * t - axis)[:2]))
    opening = {**BIN, "radius_m": off_m + cell.object.radius_m - 1e-3}
    asked = {**document["request"], "release": {**ACROSS, "opening": opening}, "release_window_s": 0.0}
    found = verify({**document, "request": asked}, cell).open
    assert any(each.detail.startswith("the bin's wall") for each in found), list(map(str, found))


def test_a_plan_whose_profile_is_not_given_is_not_proven():
    document, cell, _ = planned("learnt")
    verdict = verify(document, cell)
    assert verdict.status is Status.NOT_PROVEN
    assert {"landing", "joint_torque", "flight_clearance"} <= {each.name for each in verdict.open}
    assert all("profile p1, whose numbers are not given" in each.detail for each in verdict.open)


@pytest.mark.parametrize(
    "change",
    [
        lambda d, p: p.update(id="p2"),
        lambda d, p: p.update(cell_sha256="0"),
        lambda d, p: p.update(jitter_s=-0.001),
        lambda d, p: p.update(speed_factor=0.0),
        lambda d, p: p.update(speed_factor=1e4),
        lambda d, p: p.update(lag_s=1e300),
        lambda d, p: p.update(lag_s="0.5"),
        lambda d, p: p.update(jitter_s=True),
        lambda d, p: p.update(drag_coefficient=float("nan")),
        lambda d, p: p.pop("delay_s"),
        lambda d, p: d.update(profile=None),
        lambda d, p: d["aim"].update(shift_m=[0.0, 0.0, 0.01]),
        lambda d, p: d["aim"].update(shift_m=[0.0, float("inf"), 0.0]),
        lambda d, p: d["aim"].update(shift_m=[0.0, 0.0]),
    ],
)
def test_what_no_learnt_plan_can_say_is_refused(change: Fault):
    document, cell, profile = planned("learnt")
    document, profile = copy.deepcopy(document), copy.deepcopy(profile)
    change(document, profile or {})
    with pytest.raises(NotAPlan):
        verify(document, cell, profile)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("starts_at_s"),
        lambda d: d.update(starts_at_s="1000"),
        lambda d: d["request"]["release"].pop("observed_at_s"),
        lambda d: d["request"]["release"].update(velocity=[0.0, 0.4, 0.1]),
        lambda d: d["request"]["release"].update(velocity=[0.0, 0.4]),
    ],
)
def test_what_no_plan_at_a_moving_target_can_say_is_refused(change: Callable[[dict[str, Any]], Any]):
    document, cell, _ = planned("moving")
    document = copy.deepcopy(document)
    change(document)
    with pytest.raises(NotAPlan):
        verify(document, cell)
