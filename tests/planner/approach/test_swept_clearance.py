"""Lower bounds on the clearance between positions, against positions in between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach.swept_clearance import PATHS_AT_ONCE, SweptPaths, keep_clear, swept_clearances
from planner.cell import Box, shape_of
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.approach.conftest import BrakedThrow

CUBE = Box(np.array([0.4, -0.1, 0.5]), np.array([0.6, 0.1, 0.7]))
ROOMS = (
    Box(np.full(3, -2.0), np.full(3, 2.0)),
    *(
        shape_of(kind, pose([0.1, 0.2, 0.4], rotation_vector_to_matrix([0.3, 0.8, 0.2])), np.array(size))
        for kind, size in (
            ("box", [1.5, 1.2, 1.0]),
            ("cylinder", [0.6, 1.0]),
            ("sphere", [0.7, 0.0]),
            ("capsule", [0.5, 0.5]),
        )
    ),
)


@pytest.mark.parametrize("seed", range(4))
def test_between_the_positions_the_bound_holds(throw: BrakedThrow, seed: int) -> None:
    """Values at 100 positions in between are never below the bound."""
    rng = np.random.default_rng(seed)
    cell = throw.cell
    cell = replace(cell, surroundings=replace(cell.surroundings, keep_in=ROOMS, keep_out=(CUBE,)))
    a = cell.home + rng.uniform(-0.5, 0.5, 6)
    b = a + rng.uniform(-0.3, 0.3, 6)
    fine = swept_clearances(cell, SweptPaths.straight(np.linspace(a, b, 101)[None]))
    coarse = swept_clearances(cell, SweptPaths.straight(np.stack([a, b])[None]))
    for ends, positions in zip(coarse, fine, strict=True):
        assert positions.values.min() >= ends.between.min() - 1e-12, ends.name


def test_many_paths_are_those_of_each_alone(throw: BrakedThrow) -> None:
    rng = np.random.default_rng(9)
    starts = throw.cell.home + rng.uniform(-0.8, 0.8, (PATHS_AT_ONCE + 7, 6))
    q = np.linspace(starts, throw.cell.home, 9, axis=1)
    clear, broken = keep_clear(throw.cell, SweptPaths.straight(q))
    alone = [keep_clear(throw.cell, SweptPaths.straight(path[None])) for path in q]
    assert clear.tolist() == [bool(one[0]) for one, _ in alone]
    assert broken.tolist() == [bool(other[0]) for _, other in alone]
    assert 0 < clear.sum() < len(q)
    assert not (clear & broken).any()
