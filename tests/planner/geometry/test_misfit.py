"""Where an object fits: against spheres sampled around boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.geometry import arm_capsules, misfit, point_segment_distance
from tests.planner.problems import cell, with_boxes

RADIUS_M = 0.05


@pytest.mark.parametrize("floor_m", [0.0, -0.5])
def test_an_object_fits_where_its_sphere_touches_no_box(floor_m: float) -> None:
    """On the floor it lies on its target; in the air, half a metre above it, its centre passes the target."""
    here = cell()
    here = replace(
        here,
        object=replace(here.object, radius_m=RADIUS_M),
        surroundings=replace(here.surroundings, floor_z_m=floor_m),
    )
    rng = np.random.default_rng(4)
    fits = []
    for _ in range(300):
        lower = np.array([1.0, 0.0, rng.choice([0.0, 0.03, 0.09, 0.11])])
        upper = lower + rng.uniform([0.05, 0.05, 0.01], [0.3, 0.3, 0.2])
        target = np.array([*rng.uniform([0.9, -0.1], [1.4, 0.4]), 0.0])
        centre = target + np.array([0.0, 0.0, RADIUS_M if floor_m == 0.0 else 0.0])
        gap = np.linalg.norm(centre - np.clip(centre, lower, upper)) - RADIUS_M
        found = misfit(with_boxes(here, (lower, upper)), target)
        assert (found is None) == (gap > 0.0)
        fits.append(found is None)
    assert 0.05 < np.mean(fits) < 0.95


def test_a_box_that_ends_at_the_target_may_carry_the_object() -> None:
    here = with_boxes(cell(), ([0.9, -0.2, 0.0], [1.3, 0.2, 0.4]))
    for height, name in ((0.4, None), (0.4 - 2e-6, "box 0"), (-2e-6, "floor")):
        found = misfit(here, np.array([1.0 if height > 0.0 else 2.0, 0.0, height]))
        assert (None if found is None else found.name) == name


@pytest.mark.parametrize("height_m", [0.2, 0.4])
def test_on_a_box_it_lies_in_the_air_it_passes(height_m: float) -> None:
    """The box ends at 0.4 m. A sphere that lies beside a ridge or under a shelf is a radius higher."""
    here = cell()
    lies = height_m == 0.4
    here = replace(here, object=replace(here.object, radius_m=RADIUS_M))
    table = ([0.9, -0.2, 0.0], [1.3, 0.2, 0.4]) if lies else ([0.9, -0.2, 0.0], [1.3, 0.2, 0.1])
    target = np.array([1.1, 0.0, height_m])
    ridge = ([1.135, -0.2, height_m], [1.2, 0.2, height_m + 0.01])
    assert (misfit(with_boxes(here, table, ridge), target) is None) is lies
    for room, fits in ((0.07, not lies), (0.11, True)):
        shelf = ([1.0, -0.2, height_m + room], [1.2, 0.2, height_m + room + 0.02])
        found = misfit(with_boxes(here, table, shelf), target)
        assert (found is None) is fits
        assert found is None or found.how == "the object does not fit under it"
        assert found is None or found.lacking_m == pytest.approx(2.0 * RADIUS_M - room)


def test_in_the_air_it_does_not_fit_beside_the_top_of_a_box_or_the_base() -> None:
    here = cell()
    here = replace(here, object=replace(here.object, radius_m=RADIUS_M))
    for top in (0.5, 0.49):  # as high as the target, and lower by less than the radius
        found = misfit(with_boxes(here, ([0.9, -0.2, 0.0], [1.3, 0.2, top])), np.array([1.305, 0.0, 0.5]))
        assert found is not None
        assert found.how == "the object does not fit beside it"
        assert found.lacking_m == pytest.approx(0.005)  # onto it
    found = misfit(with_boxes(here, ([0.9, -0.2, 0.0], [1.3, 0.2, 0.5])), np.array([1.348, 0.0, 0.52]))
    assert found is None
    found = misfit(here, np.array([0.1, 0.0, 0.051]))
    assert found is not None
    assert (found.name, found.how) == ("the arm's base", "the object does not fit beside it")


@pytest.mark.parametrize("above_m", [0.0, 0.001, 0.03])
def test_a_target_a_little_above_boxes_is_on_them(above_m: float) -> None:
    """What is thrown to a height measured too high comes to lie on the table all the same."""
    here = replace(cell(), object=replace(cell().object, radius_m=RADIUS_M))
    halves = ([0.9, -0.2, 0.0], [1.1, 0.2, 0.4]), ([1.1, -0.1, 0.0], [1.4, 0.1, 0.4])
    ridge = ([1.16, -0.2, 0.4], [1.2, 0.2, 0.41])
    shelf = ([1.0, -0.2, 0.495], [1.3, 0.2, 0.5])
    for x in (1.09, 1.1, 1.11):
        target = np.array([x, 0.05, 0.4 + above_m])
        assert misfit(with_boxes(here, *halves), target) is None
        assert misfit(with_boxes(here, *halves, ridge), target) is None
        found = misfit(with_boxes(here, *halves, shelf), target)
        assert found is not None
        assert (found.lacking_m, found.name) == (pytest.approx(0.005), "box 2")


def test_what_is_lacking_is_the_way_to_where_it_fits() -> None:
    here = with_boxes(cell(), ([1.0, -0.5, 0.0], [1.3, 0.5, 1.0]))
    radius = here.object.radius_m
    for x in (1.0 - 0.9 * radius, 1.0, 1.001, 1.1):
        found = misfit(here, np.array([x, 0.0, 0.0]))
        assert found is not None
        assert found.lacking_m == pytest.approx(x - 1.0 + radius)
        assert misfit(here, np.array([x - found.lacking_m, 0.0, 0.0])) is None


def test_no_target_is_within_the_base() -> None:
    found = misfit(cell(), np.array([0.05, 0.0, 0.0]))
    assert found is not None
    foot = arm_capsules(cell().robot)[0]
    assert (found.name, foot.name) == ("the arm's base", "foot")
    lacking = foot.radius_m - point_segment_distance(np.array([0.05, 0.0, 0.0]), foot.p0, foot.p1)
    assert found.lacking_m == pytest.approx(float(lacking))
    assert found.lacking_m == pytest.approx(0.0755 - 0.05, abs=0.003)  # source: UR5e, mesh of the base
    assert misfit(cell(), np.array([0.08, 0.0, 0.0])) is None
