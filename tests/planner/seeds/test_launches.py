"""Release velocities within a requested range of elevations, however narrow."""

from dataclasses import replace

import numpy as np
import pytest

from planner.errors import Infeasible
from planner.flight import elevation, fly
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import candidates
from planner.seeds.launches import is_slow_enough, launches, no_flight
from tests.planner.problems import cell

TARGET = np.array([1.2, 0.3, 0.0])
WITHOUT_NEAREST = SearchHints(offers_nearest=False)


def thrown(**bounds) -> ThrowProblem:
    here = cell()
    return ThrowProblem(here, here.home, TargetRelease(TARGET, **bounds), here.limits)


def places(count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 1.2], (count, 3))


@pytest.mark.parametrize(("low", "high"), [(0.5, 0.5), (-0.3, -0.299), (0.78, 0.82), (1.3, 1.5)])
def test_every_place_from_which_a_flight_within_the_elevations_falls_on_the_target_has_one(low, high):
    problem, p = thrown(min_elevation_rad=low, max_elevation_rad=high), places(200)
    v, allowed = launches(problem, problem.release, p, thorough=False)
    spread = np.hypot(*(TARGET - p)[:, :2].T)
    steep_enough = np.arctan2(TARGET[2] - p[:, 2], spread) < high  # of the straight line down to the target
    np.testing.assert_array_equal(allowed.any(axis=0), steep_enough & is_slow_enough(problem, problem.release, p))
    assert (allowed.any(axis=0)).any()
    kept = elevation(v[allowed])
    assert kept.min() >= low - 1e-8
    assert kept.max() <= high + 1e-8


def test_without_requested_elevations_the_flights_are_those_of_the_times_alone():
    p = places(50)
    v, _ = launches(thrown(), thrown().release, p, thorough=False)
    wide = thrown(min_elevation_rad=-1.55, max_elevation_rad=1.55)
    np.testing.assert_array_equal(v, launches(wide, wide.release, p, thorough=False)[0])


@pytest.mark.parametrize("drag_coefficient", [0.0, 0.5])
def test_candidates_and_answers_keep_a_narrow_range_of_elevations(drag_coefficient):
    problem = thrown(min_elevation_rad=0.5, max_elevation_rad=0.501)
    problem = replace(
        problem,
        cell=replace(
            problem.cell, object=replace(problem.cell.object, radius_m=0.04, drag_coefficient=drag_coefficient)
        ),
    )
    for each in candidates(problem):
        tool = tool_state(problem.cell, each.q, each.qd)
        assert 0.5 - 1e-6 <= elevation(tool.v_WT) <= 0.501 + 1e-6
        hit = fly(tool.p_WT, tool.v_WT, 0.0, problem.gravity, problem.drag)
        np.testing.assert_allclose(hit.landing_point, TARGET, atol=1e-5)
    assert plan(problem, WITHOUT_NEAREST).certificate.valid


def test_a_given_place_has_an_answer_at_one_elevation():
    place = np.array([0.5, 0.1, 0.6])
    assert plan(thrown(release_position=place, min_elevation_rad=0.5, max_elevation_rad=0.5)).certificate.valid


def test_elevations_from_which_nothing_comes_down_on_the_target_are_named():
    high = replace(thrown().release, p_W=np.array([0.9, 0.2, 1.6]), min_elevation_rad=-0.5, max_elevation_rad=-0.4)
    with pytest.raises(Infeasible) as refused:
        candidates(replace(thrown(), release=high))
    (found,) = refused.value.violations
    assert (found.constraint, found.limit, found.unit) == ("release_velocity", -0.4, "rad")
    assert found.value > found.limit


def test_the_least_speed_is_that_within_the_elevations():
    problem, p = thrown(min_elevation_rad=1.2, max_elevation_rad=1.3), places(1)
    found = no_flight(problem, problem.release, p)
    t = np.linspace(0.05, 3.0, 200_000)[:, None]
    v = (TARGET - p) / t + np.array([0.0, 0.0, 0.5 * problem.gravity]) * t
    within = (elevation(v) >= 1.2) & (elevation(v) <= 1.3)
    assert found.value == pytest.approx(np.linalg.norm(v[within], axis=1).min(), rel=1e-4)
