"""Where an object fits: against spheres sampled around boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.geometry import misfit
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
    rng, fits = np.random.default_rng(4), []
    for _ in range(300):
        lower = np.array([1.0, 0.0, rng.choice([0.0, 0.03, 0.09, 0.11])])
        upper = lower + rng.uniform([0.05, 0.05, 0.01], [0.3, 0.3, 0.2])
        target = np.array([*rng.uniform([0.9, -0.1], [1.4, 0.4]), 0.0])
        centre = target + np.array([0.0, 0.0, RADIUS_M if floor_m == 0.0 else 0.0])
        gap = np.linalg.norm(centre - np.clip(centre, lower, upper)) - RADIUS_M
        under = bool(np.all((target[:2] > lower[:2]) & (target[:2] < upper[:2]))) and floor_m < 0.0
        found = misfit(with_boxes(here, (lower, upper)), target)
        if under:  # what comes to lie there has to fit under it, too
            assert (found is None) == (lower[2] >= 2.0 * RADIUS_M)
            continue
        assert (found is None) == (gap > 0.0)
        fits.append(found is None)
    assert 0.05 < np.mean(fits) < 0.95


def test_a_box_that_ends_at_the_target_may_carry_the_object() -> None:
    here = with_boxes(cell(), ([0.9, -0.2, 0.0], [1.3, 0.2, 0.4]))
    for height, name in ((0.4, None), (0.4 - 2e-6, "box 0"), (-2e-6, "floor")):
        found = misfit(here, np.array([1.0 if height > 0.0 else 2.0, 0.0, height]))
        assert (None if found is None else found.name) == name


def test_no_target_is_within_the_base() -> None:
    found = misfit(cell(), np.array([0.05, 0.0, 0.0]))
    assert found is not None
    assert (found.name, found.lacking_m) == ("the arm's base", pytest.approx(0.025))
    assert misfit(cell(), np.array([0.08, 0.0, 0.0])) is None
