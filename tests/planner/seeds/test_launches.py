"""Release velocities within a requested range of elevations, however narrow."""

from dataclasses import replace

import numpy as np
import pytest

from planner.errors import Infeasible
from planner.flight import elevation, fly, launch_velocity, time_at_elevation
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import candidates
from planner.seeds.launches import is_slow_enough, launches, no_flight, with_drag
from tests.planner.problems import cell

TARGET = np.array([1.2, 0.3, 0.0])
WITHOUT_NEAREST = SearchHints(offers_nearest=False)


def thrown(**bounds) -> ThrowProblem:
    here = cell()
    return ThrowProblem(here, here.home, TargetRelease(TARGET, **bounds), here.limits)


def thrown_to(target, **bounds) -> ThrowProblem:
    problem = thrown(**bounds)
    return replace(problem, release=replace(problem.release, p_W=np.array(target)))


def throwing(problem: ThrowProblem, **thing) -> ThrowProblem:
    return replace(problem, cell=replace(problem.cell, object=replace(problem.cell.object, **thing)))


def places(count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 1.2], (count, 3))


@pytest.mark.parametrize("height_m", [0.0, 0.9])
@pytest.mark.parametrize(("low", "high"), [(0.5, 0.5), (-0.3, -0.299), (0.78, 0.82), (1.3, 1.5)])
def test_every_place_from_which_a_flight_within_the_elevations_falls_on_the_target_has_one(low, high, height_m):
    problem = thrown(min_elevation_rad=low, max_elevation_rad=high)
    p = places(200)
    problem = replace(problem, limits=replace(problem.limits, tcp_speed_max=8.0))  # m/s, for those that rise steeply
    release = replace(problem.release, p_W=np.array([1.2, 0.3, height_m]))
    v, allowed = launches(replace(problem, release=release), release, p)
    t = np.linspace(0.02, 4.0, 4000)[:, None]  # all flights there are
    d = release.p_W - p
    slope = (d[:, 2] / t + 0.5 * problem.gravity * t) / (np.hypot(d[:, 0], d[:, 1]) / t)
    speed = np.hypot(d[:, 2] / t + 0.5 * problem.gravity * t, np.hypot(d[:, 0], d[:, 1]) / t)
    falls = d[:, 2] / t - 0.5 * problem.gravity * t < 0.0
    fits = falls & (np.arctan(slope) >= low - 2e-3) & (np.arctan(slope) <= high + 2e-3)
    known = (fits & (speed <= problem.limits.tcp_speed_max)).any(axis=0)
    found = allowed.any(axis=0)
    assert np.mean(found != known) < 0.03  # places at the very end of what is possible
    np.testing.assert_array_equal(found, is_slow_enough(problem, release, p))
    assert found.any() or (low, height_m) == (-0.3, 0.9)
    kept = elevation(v[allowed])
    assert kept.min(initial=low) >= low - 1e-8
    assert kept.max(initial=high) <= high + 1e-8


def test_without_requested_elevations_the_flights_are_those_of_the_times_alone():
    p = places(50)
    v, _ = launches(thrown(), thrown().release, p)
    wide = thrown(min_elevation_rad=-1.55, max_elevation_rad=1.55)
    np.testing.assert_array_equal(v, launches(wide, wide.release, p)[0])


@pytest.mark.parametrize(("mass_kg", "drag_coefficient", "high"), [(0.05, 0.0, 0.501), (0.0027, 0.5, 0.5)])
def test_candidates_and_answers_keep_a_narrow_range_of_elevations(mass_kg, drag_coefficient, high):
    """With drag a table tennis ball of 2.7 g, whose elevation is a tenth off that without."""
    problem = thrown(min_elevation_rad=0.5, max_elevation_rad=high)
    problem = throwing(problem, radius_m=0.02, mass_kg=mass_kg, drag_coefficient=drag_coefficient)
    for each in candidates(problem):
        tool = tool_state(problem.cell, each.q, each.qd)
        assert 0.5 - 2e-6 <= elevation(tool.v_WT) <= high + 2e-6
        hit = fly(tool.p_WT, tool.v_WT, 0.0, problem.gravity, problem.drag)
        np.testing.assert_allclose(hit.landing_point, TARGET, atol=1e-5)
    assert plan(problem, WITHOUT_NEAREST).certificate.valid


def test_flights_with_drag_have_the_elevation_that_is_asked_for():
    problem = throwing(thrown(min_elevation_rad=0.5, max_elevation_rad=0.5), mass_kg=0.0027, drag_coefficient=0.5)
    p = places(100)
    release = problem.release
    t = time_at_elevation(p, TARGET, 0.5, problem.gravity)
    p = p[np.isfinite(t)]
    t = t[np.isfinite(t)]
    v = with_drag(problem, release, p, t)
    assert np.isfinite(v).all(axis=1).mean() > 0.95
    found = elevation(v[np.isfinite(v).all(axis=1)])
    np.testing.assert_allclose(found, 0.5, atol=1e-6)
    without = elevation(launch_velocity(p, TARGET, t, problem.gravity, problem.drag))
    assert np.nanmax(np.abs(without - 0.5)) > 0.05  # as if there were none


@pytest.mark.slow
def test_drag_that_stops_every_flight_leaves_no_candidate():
    """At k = 2.4/m none of the drag-free flights that it would take has a time."""
    problem = thrown(min_elevation_rad=1.2, max_elevation_rad=1.2)
    problem = throwing(problem, radius_m=0.1, mass_kg=0.004, drag_coefficient=0.5)
    with pytest.raises(Infeasible):
        candidates(problem)


def test_few_throws_within_the_elevations_call_for_more_postures():
    found = candidates(
        thrown_to([-0.982067764, 1.06552939, 0.4], min_elevation_rad=0.4399582, max_elevation_rad=0.4599582)
    )
    assert len(found) >= 20  # of the first postures 1


@pytest.mark.parametrize("high", [0.5, -0.5, -np.pi / 2])
def test_a_target_straight_below_is_thrown_down_at(high):
    below = {"release_position": np.array([0.5, 0.1, 0.6]), "max_elevation_rad": high}
    assert plan(thrown_to([0.5, 0.1, 0.0], **below)).certificate.valid
    if high > -1.5:
        with pytest.raises(Infeasible, match=rf"release_velocity: 1.571 rad against a limit of {high} rad"):
            candidates(thrown_to([0.5, 0.1, 0.0], **below, min_elevation_rad=-1.5))  # what else falls was thrown up


def test_throws_of_the_first_postures_are_kept_where_more_are_drawn():
    """The states that are drawn then release after 0.436 s, the first ones, too few, after 0.36 s."""
    bounds = {"min_elevation_rad": 0.38403, "max_elevation_rad": 0.38503}
    problem = thrown_to([1.5586303748, 0.7641161635, 0.3951294452], **bounds)
    assert plan(problem).trajectory.release_time_s < 0.4


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
    problem = thrown(min_elevation_rad=1.2, max_elevation_rad=1.3)
    p = places(1)
    found = no_flight(problem, problem.release, p)
    t = np.linspace(0.05, 3.0, 200_000)[:, None]
    v = (TARGET - p) / t + np.array([0.0, 0.0, 0.5 * problem.gravity]) * t
    within = (elevation(v) >= 1.2) & (elevation(v) <= 1.3)
    assert found.value == pytest.approx(np.linalg.norm(v[within], axis=1).min(), rel=1e-4)
