"""Flights that the request fixes and that meet an obstacle: refused before any search, and only then."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box
from planner.certificate import certify
from planner.flight import fly
from planner.planning import plan
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.refusal.released_flight import released_flight_blocked
from tests.planner.problems import contact_cell as cell
from tests.planner.problems import feasible_states, ideal_cell, pose_problem

WALL = Box(np.array([0.8, -0.6, 0.0]), np.array([0.85, 0.6, 0.7]))


def thrown(v: list[float], *boxes: Box, p: tuple[float, float, float] = (0.5, 0.1, 0.6)) -> ThrowProblem:
    here = ideal_cell()
    here = replace(here, surroundings=replace(here.surroundings, keep_out=boxes))
    return ThrowProblem(here, here.home, PointRelease(np.array(p), np.array(v)), here.limits)


def test_a_flight_into_a_wall_is_refused_with_depth_time_and_name() -> None:
    violation = released_flight_blocked(thrown([2.0, 0.0, 0.5], WALL))
    assert violation is not None
    assert (violation.constraint, violation.limit, violation.proven) == ("flight_clearance", 0.0, True)
    assert violation.value == pytest.approx(-0.02)  # the centre passes through: the object's radius
    assert violation.detail.startswith("box 0, 0.1")
    assert "land on a box" not in violation.detail


def test_a_flight_that_comes_down_on_a_box_is_told_how_to_land_there() -> None:
    table = Box(np.array([0.8, -0.6, 0.0]), np.array([2.0, 0.6, 0.3]))
    violation = released_flight_blocked(thrown([2.0, 0.0, 0.5], table))
    assert violation is not None
    assert violation.detail.endswith("; to land on a box, ask for a target on it")


def test_a_wall_is_met_after_the_touch_of_the_floor() -> None:
    """The sphere touches the floor before the wall, and its centre would come to the floor within a radius of it."""
    p = np.array([0.6, 0.4, 0.3])
    v = np.array([2.28, 0.0, 0.5])
    radius = cell().object.radius_m
    touch, landing = (fly(p, v, height, 9.81).landing_point[0] for height in (radius, 0.0))
    assert landing - touch > 0.008
    trajectory = plan(thrown(v.tolist(), p=(0.6, 0.4, 0.3))).trajectory
    for away, refused in ((0.4 * radius, True), (1.01 * radius, False)):
        wall = Box(np.array([landing + away, -0.6, 0.0]), np.array([landing + away + 0.02, 0.6, 0.1]))
        problem = thrown(v.tolist(), wall, p=(0.6, 0.4, 0.3))
        assert touch + radius < landing + away
        assert (released_flight_blocked(problem) is not None) == refused
        assert certify(problem, trajectory).check("flight_clearance").ok != refused


def test_a_slab_flush_with_the_floor_is_floor() -> None:
    slab = Box(np.array([0.8, -0.6, -0.1]), np.array([2.0, 0.6, 0.0]))
    assert released_flight_blocked(thrown([2.0, 0.0, 0.5], slab)) is None
    assert plan(thrown([2.0, 0.0, 0.5], slab)).certificate.valid


def test_a_flight_over_the_wall_is_not() -> None:
    assert released_flight_blocked(thrown([2.0, 0.0, 3.0], WALL)) is None


def test_a_flight_that_grazes_is_left_to_the_certificate() -> None:
    t = np.linspace(0.0, 0.3, 30001)
    x = 0.5 + 2.0 * t
    z = 0.6 - 0.5 * 9.81 * t**2

    def gap(top: float) -> float:
        return float(np.hypot(x - np.clip(x, 0.8, 0.801), np.maximum(z - top, 0.0)).min()) - 0.02

    low = 0.3
    high = 0.6
    for _ in range(40):
        low, high = (low, (low + high) / 2) if gap((low + high) / 2) < 0.0 else ((low + high) / 2, high)
    for top, refused in ((low, False), (low + 0.01, True)):
        post = Box(np.array([0.8, -0.6, 0.0]), np.array([0.801, 0.6, top]))
        assert (released_flight_blocked(thrown([2.0, 0.0, 0.0], post)) is not None) == refused


def test_a_flight_back_onto_the_base_is_refused() -> None:
    violation = released_flight_blocked(thrown([-1.5, -0.3, 0.0]))
    assert violation is not None
    assert "base" in violation.detail or "foot" in violation.detail


def test_a_base_that_is_met_just_before_the_touch_is_seen() -> None:
    """Of the instants that are looked at first, one before has room and the next is after the touch."""
    violation = released_flight_blocked(thrown([-3.449, 0.0, -2.578], p=(0.294, -0.012, 0.192)))
    assert violation is not None
    assert "base" in violation.detail or "foot" in violation.detail


def test_released_postures_with_a_known_throw_are_not_refused() -> None:
    for known, _ in feasible_states(cell(), 5, 4):
        problem = pose_problem(known.cell, known.release.q, known.release.qd)
        assert released_flight_blocked(problem) is None


def test_a_target_does_not_fix_the_flight() -> None:
    problem = thrown([2.0, 0.0, 0.5], WALL)
    target = TargetRelease(np.array([1.2, 0.1, 0.1]))
    assert released_flight_blocked(replace(problem, release=target)) is None


def test_a_demand_beyond_all_arms_is_not_followed_through_the_sky() -> None:
    tracemalloc.start()
    assert released_flight_blocked(thrown([0.0, -0.5, 3e5])) is None  # 17 hours of flight; its speed is refused
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e7
