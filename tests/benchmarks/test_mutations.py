"""Limits drawn a few millionths inside the true peaks of certified plans, on every arm; the benchmark does more."""

import pytest

from benchmarks.mutations import certified_plans, mutations
from planner.robots import ROBOT_NAMES

LIMITS_MIN = 63  # of each plan


@pytest.mark.slow
def test_every_limit_inside_its_peak_is_refused_on_every_arm():
    arms = set()
    rates = set()
    for name, problem, trajectory in certified_plans(len(ROBOT_NAMES), seed=1):
        arms.add(problem.cell.robot.name)
        rates.add(trajectory.sample_rate_hz)
        drawn = list(mutations(problem, trajectory))
        assert len(drawn) >= LIMITS_MIN
        assert [each.limit for each in drawn if not each.is_refused(trajectory)] == [], name
    assert len(arms) >= 7
    assert rates == {125.0, 500.0}
