"""The verifier's capsules and pairs are at least those that the planner looks at, of every arm."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.mutations import cell_of_arm
from planner.geometry import body_model
from planner.robots import ROBOT_NAMES
from verifier.capsules import capsules_of
from verifier.solids import judged_pairs


@pytest.mark.parametrize("arm", ROBOT_NAMES)
def test_capsules_and_pairs_are_those_of_the_planner_or_more(arm: str):
    body = body_model(cell_of_arm(arm))
    found = capsules_of(body.cell)
    assert [capsule.name for capsule in found] == list(body.names)
    assert [capsule.frame for capsule in found] == body.frames.tolist()
    np.testing.assert_allclose([capsule.ends for capsule in found], body.ends, atol=1e-15)
    np.testing.assert_allclose([capsule.radius_m for capsule in found], body.radii, atol=1e-15)
    assert set(map(tuple, body.pairs.tolist())) <= set(judged_pairs(body.cell))
