"""Accelerations at passages, against all combinations."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from planner.backends.ruckig_otg import least_leg_time
from planner.search import passing
from planner.search.passing import passing_accelerations
from tests.planner.problems import joint_problem


@pytest.mark.parametrize("seed", range(20))
def test_no_combination_of_values_is_sooner_on_both_sides_together(seed: int) -> None:
    left, right = np.random.default_rng(seed).uniform(0.1, 1.0, (2, 4, 3))
    left[0, 1] = np.inf  # refused
    chosen = passing._soonest(left, right)
    joints = np.arange(4)
    sums = [left[joints, i].max() + right[joints, i].max() for i in map(list, product(range(3), repeat=4))]
    assert left[joints, chosen].max() + right[joints, chosen].max() == min(sums)


@pytest.mark.parametrize("seed", range(4))
def test_states_passed_with_chosen_accelerations_are_passed_sooner(seed: int) -> None:
    """By Ruckig itself, all joints together; an acceleration that is given stays."""
    problem = joint_problem()
    rng = np.random.default_rng(seed)
    zero = np.zeros(6)
    q = problem.start + rng.uniform(-0.6, 0.6, (4, 6)).cumsum(axis=0)
    qd = 0.4 * problem.limits.qd_max * rng.uniform(-1.0, 1.0, (4, 6))
    states = [(problem.start, zero, zero), *((q[i], qd[i], zero) for i in range(4)), None]
    found = passing_accelerations(problem, [*pairwise(states)], [True, True, False, True])
    assert (np.abs(found) <= problem.limits.qdd_max).all()
    assert np.array_equal(found[2], zero)
    eased = [states[0], *((q[i], qd[i], found[i]) for i in range(4)), None]
    before, after = (sum(least_leg_time(problem, *each) for each in pairwise(way)) for way in (states, eased))
    assert after < 0.98 * before
