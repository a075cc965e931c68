"""Averaging: bounds kept, the release exact, and the double S in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from planner.problem import JointRelease
from planner.seeds import candidates
from planner.timing import RawMotion, shortest_trapezoid, smooth
from tests.planner.problems import cell, joint_problem


def to_rest(problem, candidate):
    """The trapezoid over the whole way, to be averaged."""

    def make(limits, width):
        motion = shortest_trapezoid(candidate.q - problem.start, candidate.qd, limits, problem.dt)
        launch = motion.at(np.arange(round(motion.duration_s / problem.dt) + 1) * problem.dt)[1]
        return RawMotion(launch, np.zeros((width + 1, 6)), np.zeros((1, 6)))

    return make


@pytest.mark.parametrize("distance", [1.2, 0.15], ids=["with a cruise", "without one"])
def test_an_averaged_trapezoid_is_the_double_s(distance):
    """Source: Biagiotti and Melchiorri, section 3.4: the least time with bounded jerk, with and without a cruise."""
    here = cell()
    v = 2.0
    a = 10.0
    j = 500.0
    limits = replace(here.limits, qd_max=np.full(6, v), qdd_max=np.full(6, a), jerk_max=np.full(6, j))
    problem = joint_problem(release=JointRelease(here.home + distance * np.eye(6)[0], np.zeros(6)), limits=limits)
    candidate = candidates(problem)[0]
    trajectory, width = smooth(problem, candidate, to_rest(problem, candidate))
    least = distance / v + v / a + a / j if distance > 1.0 else a / j + np.sqrt((a / j) ** 2 + 4 * distance / a)
    assert a / j - 1e-9 <= width <= 2 * a / j + 1e-9
    assert least - 1e-9 <= trajectory.duration_s <= least + 4 * problem.dt
    assert np.abs(trajectory.jerk).max() <= j * (1 + 1e-7)
    np.testing.assert_array_equal(trajectory.q[-1], candidate.q)


def test_the_release_keeps_its_state_and_the_passage_its_speed():
    problem = joint_problem()
    candidate = candidates(problem)[0]

    def make(limits, width):
        half = width * problem.dt / 2
        d = candidate.q - candidate.qd * half - problem.start
        motion = shortest_trapezoid(d, candidate.qd, limits, problem.dt)
        launch = motion.at(np.arange(round(motion.duration_s / problem.dt) + 1) * problem.dt)[1]
        passage = np.tile(candidate.qd, (width + 1, 1))
        return RawMotion(launch, passage, np.linspace(candidate.qd, np.zeros(6), 100))

    trajectory, width = smooth(problem, candidate, make)
    k = trajectory.release_index
    np.testing.assert_array_equal(trajectory.q[k], candidate.q)
    np.testing.assert_array_equal(trajectory.qd[k], candidate.qd)
    np.testing.assert_allclose(trajectory.qdd[k], 0.0, atol=1e-9)
    assert width > 0.0
    brake = trajectory.q[-1] - candidate.q  # half a window and 99 ticks of even braking, averaged
    np.testing.assert_allclose(brake, candidate.qd * (width / 2 + 99 * problem.dt / 2), rtol=1e-3)
