"""Projections bound distances from solids, and are as close as a dense sampling of their surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from planner.cell import Solid, shape_of
from planner.rotations import pose, rotation_vector_to_matrix
from verifier.solids import (
    apart_between,
    apart_from_solid,
    from_solid,
    nearest_on_segments,
    out_of_solid,
    support,
    toward,
)
from verifier.taylor import TaylorModel

X_WC = pose(np.array([0.3, -0.2, 0.5]), rotation_vector_to_matrix(np.array([0.4, -0.7, 0.2])))
SOLIDS = {
    "box": shape_of("box", X_WC, np.array([0.2, 0.3, 0.1])),
    "cylinder": shape_of("cylinder", X_WC, np.array([0.1, 0.4])),
    "sphere": shape_of("sphere", X_WC, np.array([0.15, 0.0])),
    "capsule": shape_of("capsule", X_WC, np.array([0.05, 0.3])),
}


def still(x: np.ndarray) -> TaylorModel:
    """Places that do not move, as a model."""
    zero = np.zeros_like(x)
    return TaylorModel(x, zero, zero, zero)


def points_in(solid: Solid, rng: np.random.Generator, count: int = 60_000) -> np.ndarray:
    """Points (3, k) of a solid."""
    x = rng.uniform(solid.lower, solid.upper, (count, 3))
    return x[solid.depth(x) >= 0.0].T


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_solid_reaches_as_far_as_its_farthest_point(kind: str):
    rng = np.random.default_rng(1)
    solid = SOLIDS[kind]
    n = toward(rng.normal(size=(3, 50)))
    farthest = (n.T @ points_in(solid, rng)).max(axis=1)
    reach = support(solid, n)
    assert (reach >= farthest).all()
    assert (reach - farthest).max() < 0.03


@pytest.mark.parametrize("kind", SOLIDS)
def test_the_distance_of_a_segment_from_a_solid_is_bounded_closely(kind: str):
    rng = np.random.default_rng(2)
    solid = SOLIDS[kind]
    ends = rng.uniform(-1.0, 1.5, (2, 3, 200))
    out = out_of_solid(ends, solid)
    bound = apart_from_solid([still(end) for end in ends], solid, toward(out))
    along = ends[0] + np.linspace(0.0, 1.0, 2001)[:, None, None] * (ends[1] - ends[0])
    sampled = np.linalg.norm([from_solid(x, solid) for x in along], axis=1).min(axis=0)
    assert (bound <= sampled + 1e-12).all()
    apart = sampled > 1e-3
    assert apart.sum() > 100
    assert (sampled - bound)[apart].max() < 1e-3


def test_any_direction_bounds_a_distance_and_the_nearest_points_give_all_of_it():
    rng = np.random.default_rng(3)
    a, b = rng.uniform(-1.0, 1.0, (2, 2, 3, 500))
    one, two = nearest_on_segments(a, b)
    distance = np.linalg.norm(one - two, axis=0)
    models = [[still(end) for end in ends] for ends in (a, b)]
    assert (apart_between(*models, toward(rng.normal(size=(3, 500)))) <= distance + 1e-12).all()
    np.testing.assert_allclose(apart_between(*models, toward(one - two)), distance, atol=1e-9)
