"""Margins that learn from a certificate's failed checks."""

from __future__ import annotations

import numpy as np
import pytest

from planner.backends.casadi_nlp import CLOSE, far_off
from planner.certificate import Check, at_least, at_most
from planner.solution import Solution
from planner.trajectory import Trajectory

ZEROS = np.zeros((101, 6))
SOLUTION = Solution(Trajectory(500.0, ZEROS, ZEROS, ZEROS, 80), "", held=frozenset({"effort"}))  # 0.16 s and 0.2 s


def test_what_was_lacking_is_added_where_it_was() -> None:
    wide = CLOSE.widened(
        [at_least("floor", 0.012, 0.02, "m", 0.12), at_most("joint_torque", 165.0, 150.0, "Nm", 0.18)], SOLUTION
    )
    assert wide is not None
    floor, torque = wide.spots
    assert (floor.check, floor.share) == ("floor", pytest.approx(0.75))
    assert 0.008 < floor.amount < 0.016
    assert (torque.check, torque.share) == ("joint_torque", pytest.approx(1.5))
    assert 0.1 < torque.amount < 0.12
    assert wide.held == {"space", "effort"}


def test_each_failure_adds_to_the_one_before() -> None:
    once = CLOSE.widened([at_most("joint_torque", 165.0, 150.0, "Nm", 0.1)], SOLUTION)
    assert once is not None
    twice = once.widened([at_most("joint_torque", 155.0, 150.0, "Nm", 0.14)], SOLUTION)
    assert twice is not None
    assert len(twice.spots) == 2


def test_what_a_motion_is_too_near_to_at_another_time_is_kept_away_from_everywhere() -> None:
    once = CLOSE.widened([at_least("self_collision", 0.004, 0.005, "m", 0.1)], SOLUTION)
    assert once is not None
    twice = once.widened([at_least("self_collision", 0.004, 0.005, "m", 0.14)], SOLUTION)
    assert twice is not None
    assert twice.spots == once.spots
    assert twice.self_m >= CLOSE.self_m + 0.001


def test_singularities_windows_and_positions_have_margins_of_their_own() -> None:
    near, late = at_least("singularity_distance", 0.04, 0.05, "1"), at_most("landing_window", 6e-3, 5e-3, "m")
    turned = at_least("joint_position", -1.68, -1.66, "rad", 0.1)
    wide = CLOSE.widened([near, late, turned], SOLUTION)
    assert wide is not None
    assert 0.02 < wide.position_rad < 0.04
    assert wide.singularity > CLOSE.singularity + 0.2
    assert wide.window < CLOSE.window * 5.0 / 6.0
    assert wide.held == SOLUTION.held


@pytest.mark.parametrize(
    "failure",
    [
        at_most("joint_velocity", 4.0, 3.0, "rad/s", 0.1),  # not for want of looking
        at_most("joint_torque", 400.0, 150.0, "Nm", 0.1),  # no margin helps
        at_least("keep_out", -0.5, 0.02, "m", 0.1),
        at_most("landing_window", 0.2, 5e-3, "m", 0.1),
    ],
)
def test_some_failures_have_no_remedy(failure: Check) -> None:
    assert CLOSE.widened([failure], SOLUTION) is None


def test_a_clearance_missed_by_much_calls_for_closer_looks() -> None:
    assert far_off([at_most("joint_torque", 165.0, 150.0, "Nm", 0.18), at_least("floor", 0.014, 0.02, "m", 0.12)])
    assert not far_off([at_least("floor", 0.0155, 0.02, "m", 0.12), at_most("tcp_speed", 5.0, 4.0, "m/s", 0.1)])
