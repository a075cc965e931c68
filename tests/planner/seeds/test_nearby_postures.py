"""Postures near given ones that pass a point, against scipy's least-squares with an equality constraint."""

import numpy as np
import pytest
from scipy.optimize import minimize

from planner.geometry import tool_state
from planner.seeds import near_candidates
from tests.planner.problems import cell, point_problem


@pytest.mark.parametrize("seed", range(5))
def test_they_pass_the_point_by_little_more_than_the_least_turning(seed):
    here = cell()
    rng = np.random.default_rng(seed)
    q = here.home + rng.uniform(-0.5, 0.5, 6)
    problem = point_problem(here, q, 0.2 * here.limits.qd_max)
    near = q + rng.uniform(-0.3, 0.3, (3, 6))
    point = problem.release.point_state
    found = near_candidates(problem, point, near)
    assert len(found) == 3
    for each in found:
        state = tool_state(here, each.q, each.qd)
        np.testing.assert_allclose(state.p_WT, point.p_WT, atol=1e-8)
        np.testing.assert_allclose(state.v_WT, point.v_WT, atol=1e-9)
    scale = here.limits.qd_max
    turned = min(np.linalg.norm((each.q - near[0]) / scale) for each in found)
    least = minimize(
        lambda x: (((x - near[0]) / scale) ** 2).sum(),
        near[0],
        constraints={"type": "eq", "fun": lambda x: tool_state(here, x, np.zeros(6)).p_WT - point.p_WT},
        method="SLSQP",
    )
    assert turned < 1.15 * np.sqrt(least.fun)


def test_beyond_the_arms_reach_there_are_none():
    here = cell()
    problem = point_problem(here, here.home, np.zeros(6))
    far = problem.release.moved_to(np.array([3.0, 0.0, 0.5])).point_state
    assert near_candidates(problem, far, here.home[None]) == []
