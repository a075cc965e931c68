"""The joint-wise bound against Ruckig, which can never be faster, and against double integrators in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.problem import JointRelease
from planner.seeds import Candidate, least_time
from tests.planner.problems import cell, joint_problem, random_state


def test_no_launch_is_sooner_than_the_bound():
    rng = np.random.default_rng(4)
    here = cell()
    for _ in range(60):
        q, qd = random_state(here, rng)
        problem = joint_problem(release=JointRelease(q, qd))
        bound = float(least_time(q - problem.start, qd, problem.limits))
        assert bound <= ruckig_otg.least_times(problem, Candidate(q, qd, bound, "random")).max() + 1e-9


def test_with_boundless_jerk_ruckig_comes_down_to_the_bound():
    rng = np.random.default_rng(5)
    here = cell()
    limits = replace(here.limits, jerk_max=np.full(6, 1e7))
    for _ in range(30):
        q, qd = random_state(here, rng)
        problem = joint_problem(release=JointRelease(q, qd), limits=limits)
        bound = float(least_time(q - problem.start, qd, limits))
        reached = ruckig_otg.least_times(problem, Candidate(q, qd, bound, "random"))
        assert reached.max() == pytest.approx(bound, abs=5e-4)


def test_closed_forms():
    limits = replace(cell().limits, qd_max=np.full(6, 2.0), qdd_max=np.full(6, 4.0))

    def bound(distance, speed):
        d = np.zeros(6)
        v = np.zeros(6)
        d[1] = distance
        v[1] = speed
        return float(least_time(d, v, limits))

    assert bound(1.0, 0.0) == pytest.approx(1.0)  # up and down: 2 sqrt(d / a)
    assert bound(0.5, 2.0) == pytest.approx(0.5)  # straight to speed: v / a
    assert bound(3.0, 0.0) == pytest.approx(2.0)  # 0.5 s up, 1 s at speed, 0.5 s down
    assert bound(0.0, 2.0) == pytest.approx((1.0 + np.sqrt(2.0)) / 2.0)  # back first: (2 sqrt(v^2/2) + v) / a
    assert bound(-1.0, 0.0) == bound(1.0, 0.0)
