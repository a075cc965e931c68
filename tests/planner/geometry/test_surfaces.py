"""What an object lands on: against points sampled on the tops of boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.geometry import landing_surfaces
from tests.planner.problems import cell, with_boxes

HEIGHT_M = 0.4


def test_surfaces_are_on_the_tops_of_boxes_and_the_target_is_over_them() -> None:
    rng = np.random.default_rng(3)
    several = 0
    for _ in range(100):
        cuts = np.sort(rng.choice(np.arange(0.0, 1.0, 0.1), (2, 5), replace=True), axis=1)
        cells = [
            (i, j) for i in range(4) for j in range(4) if cuts[0, i] < cuts[0, i + 1] and cuts[1, j] < cuts[1, j + 1]
        ]
        chosen = [each for each in cells if rng.uniform() < 0.7]
        boxes = [
            ([cuts[0, i], cuts[1, j], 0.0], [cuts[0, i + 1], cuts[1, j + 1], HEIGHT_M + rng.uniform(-4e-4, 0.0)])
            for i, j in chosen
        ]
        p = np.array([*rng.uniform(0.0, 1.0, 2), HEIGHT_M + rng.choice([0.0, 0.01])])
        found = landing_surfaces(with_boxes(cell(), *boxes), p)
        on_a_top = any(
            np.all(lower[:2] <= p[:2]) and np.all(p[:2] <= upper[:2]) for lower, upper in map(np.array, boxes)
        )
        assert bool(found) == on_a_top
        for surface in found:
            assert surface.depth(p) >= 0.0
            for x in rng.uniform(surface.lower, surface.upper, (50, 2)):
                assert any(np.all(lower[:2] <= x) and np.all(x <= upper[:2]) for lower, upper in map(np.array, boxes))
            several += (
                sum(np.all(surface.lower <= a[:2]) and np.all(b[:2] <= surface.upper) for a, b in map(np.array, boxes))
                > 1
            )
    assert several > 30


def test_a_table_of_many_tiles_is_one_surface() -> None:
    tiles = [([0.1 * i, 0.1 * j, 0.0], [0.1 * (i + 1), 0.1 * (j + 1), HEIGHT_M]) for i in range(8) for j in range(8)]
    (surface,) = landing_surfaces(with_boxes(cell(), *tiles), np.array([0.35, 0.4, HEIGHT_M]))
    np.testing.assert_allclose([surface.lower, surface.upper], [[0.0, 0.0], [0.8, 0.8]])


def test_tops_are_level_with_the_one_under_the_place_not_from_one_to_the_next() -> None:
    """Steps of 0.9 mm: the second one is as high as the first, to a millimetre, the third is not."""
    steps = [([0.1 * i, 0.0, 0.0], [0.1 * (i + 1), 1.0, HEIGHT_M - 0.0009 * (11 - i)]) for i in range(12)]
    (surface,) = landing_surfaces(with_boxes(cell(), *steps), np.array([0.05, 0.5, HEIGHT_M]))
    np.testing.assert_allclose([surface.lower, surface.upper], [[0.0, 0.0], [0.2, 1.0]])
    assert surface.height_m == pytest.approx(HEIGHT_M - 0.009)


def test_a_point_without_a_radius_lands_on_a_top() -> None:
    here = cell()
    point = replace(here, object=replace(here.object, radius_m=0.0))
    (top,) = landing_surfaces(with_boxes(point, ([0.8, -0.5, 0.0], [1.6, 0.5, 0.4])), np.array([1.2, 0.2, 0.4]))
    assert top.height_m == 0.4


def test_the_highest_surface_counts_within_a_radius_below_the_target() -> None:
    here = cell()
    here = replace(here, object=replace(here.object, radius_m=0.05))
    table = ([0.5, -0.5, 0.0], [1.5, 0.5, 0.3])
    plate = ([0.9, -0.1, 0.3], [1.1, 0.1, 0.32])
    stacked = with_boxes(here, table, plate)
    for x, z, height in ((1.0, 0.32, 0.32), (1.0, 0.36, 0.32), (1.0, 0.38, None), (1.3, 0.34, 0.3), (1.3, 0.36, None)):
        found = landing_surfaces(stacked, np.array([x, 0.0, z]))
        assert [surface.height_m for surface in found] == ([] if height is None else [height])
    (floor,) = landing_surfaces(here, np.array([1.0, 0.0, 0.04]))
    assert (floor.height_m, floor.depth(np.array([1e6, -1e6]))) == (0.0, np.inf)
    assert landing_surfaces(here, np.array([1.0, 0.0, 0.06])) == ()
