"""Certified throws of bodies are proven; of those with a fault in the landing, or in the way of an end, none."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.landing_orientation import OBJECTS, cell_with
from planner.answer import plan_document
from planner.cell import Cell, ThrownBody
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.request import problem_from_request
from tests.verifier.test_spin import turned_at
from verifier import NotAPlan, Status, verify
from verifier.bodies import BallReleases, may_touch
from verifier.body_checks import _above
from verifier.drag import releases_of
from verifier.flights import FlightPatches, release_pieces
from verifier.plan_document import SampledMotion

QUICK = SearchHints(offers_nearest=False)
THROW = {"kind": "target", "position": [1.1, 0.3, 0.0]}
REQUEST: dict[str, Any] = {"release": THROW, "landing_tolerance_m": 0.05, "backend": "ruckig"}
NAMES = ("rod", "brick")
TOLERANCE_RAD = 0.3


@cache
def planned(name: str) -> tuple[dict[str, Any], Cell]:
    """Documents of plans that throw a body, with its cell."""
    cell = cell_with(OBJECTS[name])
    return plan_document(plan(problem_from_request(REQUEST, cell), QUICK), REQUEST, "", ""), cell


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_certified_throw_of_a_body_is_proven(name: str):
    document, cell = planned(name)
    document = dict(document)
    axis_off(document, 0.0)
    verdict = verify(document, cell)
    assert verdict.status is Status.PROVEN, list(map(str, verdict.open))
    assert "landing_axis" in {finding.name for finding in verdict.findings}
    certified = {check["name"] for check in document["certificate"]["checks"]}
    assert certified <= {finding.name for finding in verdict.findings}


def off_by_a_millimetre(document: dict[str, Any]) -> None:
    document["request"]["release"]["position"][1] += 1e-3


def tolerance_a_hundredth_less(document: dict[str, Any]) -> None:
    worst = max(each["landing_error_m"] for each in document["flight"]["window"])
    document["request"]["landing_tolerance_m"] = 0.99 * worst


def axis_off(document: dict[str, Any], angle: float) -> None:
    """Asks for an axis that the nominal landing is off by an angle [rad]."""
    lies = np.array(document["flight"]["landing_orientation"]["axis"])
    aside = np.cross(lies, [0.0, 0.0, 1.0])
    axis = np.cos(angle) * lies + np.sin(angle) * aside / np.linalg.norm(aside)
    asked = {"axis": axis.tolist(), "tolerance_rad": TOLERANCE_RAD}
    document["request"] = {**document["request"], "release": {**THROW, "orientation": asked}}


def axis_a_hundredth_too_far(document: dict[str, Any]) -> None:
    axis_off(document, 1.01 * TOLERANCE_RAD)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("fault", "check"),
    [
        (off_by_a_millimetre, "landing"),
        (tolerance_a_hundredth_less, "landing_window"),
        (axis_a_hundredth_too_far, "landing_axis"),
    ],
)
def test_a_fault_of_a_landing_is_not_proven(name: str, fault: Callable[[dict[str, Any]], None], check: str):
    document, cell = planned(name)
    document = {**copy.deepcopy({k: v for k, v in document.items() if k != "trajectory"})} | {
        "trajectory": document["trajectory"]
    }
    fault(document)
    assert check in {each.name for each in verify(document, cell).open}


@pytest.mark.slow
@pytest.mark.parametrize(("deep_m", "is_proven"), [(0.001, False), (-0.02, True)])
@pytest.mark.parametrize("name", NAMES)
def test_a_ball_in_the_way_of_an_end_of_the_body_is_found(name: str, deep_m: float, is_proven: bool):
    """One that comes a millimetre nearer to the end than the clearance, far from the body's centre."""
    document, cell = planned(name)
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    k = document["release"]["index"]
    q, qd = (np.array(document["trajectory"][key][k]) for key in ("positions", "velocities"))
    at_s = 0.5 * document["flight"]["time_of_flight_s"]
    R_WO = turned_at(cell, q, qd, at_s)
    path = document["flight"]["object_path"]
    steps = np.append(0.02 * np.arange(len(path) - 1), document["flight"]["time_of_flight_s"])
    centre = np.array([np.interp(at_s, steps, each) for each in np.transpose(path)])
    velocity = np.array([np.gradient(each, steps)[len(steps) // 2] for each in np.transpose(path)])
    u = R_WO @ thing.hull_axis_O
    out = u - velocity * (u @ velocity) / (velocity @ velocity)  # straight out of the flight
    end = centre + thing.reach_m * u
    radius = 0.01
    away = thing.radius_m + radius + cell.surroundings.flight_clearance_m - deep_m
    place = end + away * out / np.linalg.norm(out)
    ball = {"shape": "sphere", "pose": {"position_m": place.tolist()}, "radius_m": radius}
    blocked = cell.with_obstacles(ball)
    verdict = verify({**document, "cell_sha256": blocked.sha256}, blocked)
    found = [each for each in verdict.open if each.name == "flight_clearance"]
    assert (not found) == is_proven, list(map(str, verdict.open))


@pytest.mark.parametrize(
    "fields",
    [
        {"orientation": {"axis": [0.0, 0.0, 1.0], "tolerance_rad": -1.0}},
        {"orientation": {"axis": [0.0, 0.0, 1.0], "tolerance_rad": None}},
        {"orientation": {"axis": [0.0, 0.0, 1.0], "tolerance_rad": "0.1"}},
        {"orientation": {"axis": [0.0, 0.0, 1.0]}},
        {"orientation": {"axis": [0.0, 0.0, 0.0], "tolerance_rad": 0.1}},
        {"orientation": {"axis": [0.0, 0.0, 1.0, 0.0], "tolerance_rad": 0.1}},
        {"orientation": {"axis": "abc", "tolerance_rad": 0.1}},
        {"orientation": [0.0, 0.0, 1.0]},
        {"velocity": [0.3, 0.0, 0.0], "observed_at_s": 100.0},
    ],
)
def test_what_nobody_can_ask_of_a_bodys_landing_is_refused(fields: dict[str, Any]):
    document, cell = planned("rod")
    document = copy.deepcopy(document)
    document.update(starts_at_s=100.0)
    document["request"]["release"].update(fields)
    with pytest.raises(NotAPlan):
        verify(document, cell)


def test_a_body_that_air_slows_may_touch_from_where_it_begins_to_fall():
    """Sooner than gravity alone would end its rise; where that is, an integration tells."""
    cell = cell_with({**OBJECTS["rod"], "mass_kg": 0.005})
    thing = cell.object
    drag = 1.204 * thing.drag_coefficient * np.pi * thing.drag_radius_m**2 / (2.0 * thing.mass_kg)
    jacobian = np.column_stack([tool_state(cell, cell.home, each).v_WT for each in np.eye(6)])
    qd = np.array(np.linalg.lstsq(jacobian, np.array([1.0, 0.0, 3.0]), rcond=None)[0], np.float64)
    q = cell.home + np.outer([-0.002, 0.0, 0.002], qd)
    motion = SampledMotion(500.0, q, np.tile(qd, (3, 1)), np.zeros((3, 6)), 1)
    tool = tool_state(cell, cell.home, qd)

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        return np.concatenate([v, -drag * np.linalg.norm(v) * v - np.array([0.0, 0.0, cell.surroundings.gravity_m_s2])])

    def rise(_: float, state: np.ndarray) -> float:
        return state[5]

    state = np.concatenate([tool.p_WT, tool.v_WT])
    flown = solve_ivp(rates, (0.0, 0.5), state, "DOP853", events=rise, rtol=1e-10, atol=1e-12)
    apex_s = float(flown.t_events[0][0])
    gravity_s = tool.v_WT[2] / cell.surroundings.gravity_m_s2
    assert apex_s < gravity_s - 0.01
    pieces = release_pieces(motion, 0.0)
    body = BallReleases(cell, pieces, 1, releases_of(cell, pieces), height_m=float(flown.y_events[0][0][2]))
    s0 = np.array([0.0, apex_s - 0.001, apex_s])
    patches = FlightPatches(body, np.zeros(3, np.intp), s0, s0 + 0.002)
    assert may_touch(patches).tolist() == [False, True, True]
    apex = _above(cell)(patches)[0][1]
    assert (apex[1:] < 0.0).all()  # its lower end is below the height of its centre there
