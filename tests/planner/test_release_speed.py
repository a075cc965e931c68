"""Objects that leave faster or slower than the tool, against an integration of their own (f v, gravity, drag)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner.answer import plan_document, plan_from_document
from planner.cell import Box, Cell
from planner.certificate import certify
from planner.flight import path
from planner.geometry import tool_state
from planner.planning import Plan, plan
from planner.problem import Opening, ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from tests.planner.problems import contact_cell as cell
from tests.planner.problems import ideal_cell

TARGET = [1.3, 0.2, 0.0]
DRAG_COEFFICIENT = 0.4
SAME_M = 1e-4  # [m] of a landing; the certificate allows 0.5 mm


def thrower(factor: float) -> Cell:
    """A cell whose objects leave `factor` times as fast as the tool, through air."""
    here = ideal_cell()
    gripper = replace(here.gripper, release_speed_factor=factor)
    return replace(here, gripper=gripper, object=replace(here.object, drag_coefficient=DRAG_COEFFICIENT))


@cache
def planned(factor: float, window_s: float = 0.0, opening: bool = False, backend: str = "ruckig") -> Plan:
    release = {"kind": "target", "position": TARGET}
    if opening:
        release["opening"] = {"radius_m": 0.09, "rim_height_m": 0.25}
    request = {"release": release, "release_window_s": window_s, "backend": backend}
    return plan(problem_from_request(request, thrower(factor)))


def integrated(problem: ThrowProblem, trajectory: Trajectory, factor: float, delay_s: float = 0.0) -> np.ndarray:
    """Returns the centre (n, 3) of an object released `delay_s` late, every millisecond until it passes the plane."""
    q, qd, _ = trajectory.at(trajectory.release_time_s + delay_s)
    state = tool_state(problem.cell, q, qd)
    thing = problem.cell.object
    k = 0.5 * 1.204 * thing.drag_coefficient * np.pi * thing.radius_m**2 / thing.mass_kg

    def rate(_, s):
        return [*s[3:], *(-k * np.linalg.norm(s[3:]) * s[3:] - [0.0, 0.0, 9.81])]

    def lands(_, s):
        return s[2] - problem.plane_z

    lands.terminal = True
    lands.direction = -1.0
    start = [*state.p_WT, *(factor * state.v_WT)]
    found = solve_ivp(rate, (0.0, 5.0), start, events=lands, rtol=1e-10, atol=1e-12, max_step=0.001)
    return found.y[:3].T


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_the_path_is_that_of_the_tools_velocity_under_another_gravity(drag: float):
    p = np.array([0.3, 0.1, 0.9])
    v = np.array([2.5, -1.0, 2.2])
    t = np.linspace(0.0, 0.7, 20)
    factor = 0.93
    true = path(p, factor * v, t, 9.81, drag)
    np.testing.assert_allclose(path(p, v, factor * t, 9.81 / factor**2, drag), true, atol=1e-7)


@pytest.mark.parametrize(("factor", "window_s", "backend"), [(0.95, 0.0, "ruckig"), (1.05, 0.008, "casadi")])
def test_a_plan_lands_on_the_target_with_the_objects_own_speed(factor: float, window_s: float, backend: str):
    found = planned(factor, window_s, backend=backend)
    landed = integrated(found.problem, found.trajectory, factor)[-1]
    np.testing.assert_allclose(landed, TARGET, atol=SAME_M)
    assert np.linalg.norm(integrated(found.problem, found.trajectory, 1.0)[-1] - TARGET) > 0.03
    tolerance = max(found.problem.landing_tolerance_m, SAME_M)
    for delay in np.linspace(-window_s, window_s, 5):
        off = integrated(found.problem, found.trajectory, factor, delay)[-1] - TARGET
        assert np.linalg.norm(off) <= tolerance + SAME_M


def test_a_flight_that_the_objects_speed_takes_into_a_wall_is_refused_and_planned_anew():
    """The wall ends between the flight with the tool's speed and the lower one of an object 5 % slower."""
    exact = planned(1.0)
    high, low = (integrated(exact.problem, exact.trajectory, factor) for factor in (1.0, 0.95))
    x = 0.5 * (high[-1, 0] + high[np.argmax(high[:, 2]), 0])
    tops = [float(np.interp(x, way[:, 0], way[:, 2])) for way in (high, low)]
    radius = exact.problem.cell.object.radius_m
    top = tops[0] - radius - 0.02  # 5 mm below the exact flight's sphere, beside the wall's edges
    assert tops[1] - radius < top
    wall = Box(np.array([x - 0.005, -1.0, 0.0]), np.array([x + 0.005, 1.0, top]))

    def walled(problem: ThrowProblem, factor: float) -> ThrowProblem:
        here = thrower(factor)
        return replace(problem, cell=replace(here, surroundings=replace(here.surroundings, keep_out=(wall,))))

    assert certify(walled(exact.problem, 1.0), exact.trajectory).check("flight_clearance").ok
    refused = certify(walled(exact.problem, 0.95), exact.trajectory).check("flight_clearance")
    assert (refused.ok, refused.detail) == (False, "box 0")
    found = plan(walled(exact.problem, 0.95))
    flown = integrated(found.problem, found.trajectory, 0.95)
    gaps = np.linalg.norm(flown - np.clip(flown, wall.lower, wall.upper), axis=1) - radius
    assert gaps.min() >= 0.0
    np.testing.assert_allclose(flown[-1], TARGET, atol=SAME_M)


def test_a_flight_that_the_objects_speed_takes_against_a_rim_is_refused_and_planned_anew():
    exact = planned(1.0, opening=True)
    opening = Opening(0.09, 0.25)
    here = thrower(0.97)
    judged = certify(replace(exact.problem, cell=here), exact.trajectory).check("flight_clearance")
    assert (judged.ok, judged.detail) == (False, "rim")
    found = planned(0.97, opening=True)
    flown = integrated(found.problem, found.trajectory, 0.97)
    radius = here.object.radius_m
    rho = np.hypot(flown[:, 0] - TARGET[0], flown[:, 1] - TARGET[1])
    outside = flown[: int(np.flatnonzero(flown[:, 2] >= opening.rim_height_m)[-1]) + 2]
    gap = np.hypot(rho[: len(outside)] - opening.radius_m, np.maximum(outside[:, 2] - opening.rim_height_m, 0.0))
    assert gap.min() >= radius - 0.002  # between milliseconds


def test_a_plans_document_carries_the_factor_and_old_ones_have_none():
    found = planned(0.95)
    request = {"release": {"kind": "target", "position": TARGET}, "release_window_s": 0.0}
    document = plan_document(found, request, "one", "2026-01-01T00:00:00Z")
    flight = document["flight"]
    flown = integrated(found.problem, found.trajectory, 0.95)
    np.testing.assert_allclose(flight["object_path"][-1], flown[-1], atol=SAME_M)
    assert flight["apex_height_m"] == pytest.approx(flown[:, 2].max(), abs=1e-5)
    assert flight["speed_m_s"] == pytest.approx(0.95 * np.linalg.norm(document["release"]["twist"]["linear"]))
    h = 1e-4
    late, early = (integrated(found.problem, found.trajectory, 0.95, delay)[-1] for delay in (h, -h))
    np.testing.assert_allclose(flight["landing_per_release_delay_m_s"], (late - early) / (2.0 * h), atol=0.02)
    back, trajectory = plan_from_document(document, cell())
    assert back.release_speed_factor == flight["release_speed_factor"] == 0.95
    assert back.drag == pytest.approx(flight["drag_per_m"])
    assert certify(back, trajectory).valid
    for name in ("release_speed_factor", "drag_coefficient", "drag_per_m"):
        del flight[name]
    old, _ = plan_from_document(document, thrower(0.9))
    assert old.release_speed_factor == 1.0
