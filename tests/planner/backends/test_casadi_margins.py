"""Margins that learn from a certificate's failed checks."""

from __future__ import annotations

import pytest

from planner.backends.casadi_nlp import CLOSE
from planner.certificate import Check, at_least, at_most


def test_what_was_lacking_is_added() -> None:
    wide = CLOSE.widened([at_least("floor", 0.012, 0.02, "m"), at_most("joint_torque", 165.0, 150.0, "Nm")])
    assert wide is not None
    assert wide.floor_m == pytest.approx(CLOSE.floor_m + 0.008, abs=0.002)
    assert wide.floor_m > CLOSE.floor_m + 0.008
    assert wide.torque < CLOSE.torque / 1.1
    assert wide.self_m == CLOSE.self_m
    assert wide.held == {"space", "effort"}


def test_each_failure_adds_to_the_one_before() -> None:
    once = CLOSE.widened([at_least("self_collision", 0.001, 0.005, "m")])
    assert once is not None
    twice = once.widened([at_least("self_collision", 0.004, 0.005, "m")])
    assert twice is not None
    assert CLOSE.self_m < once.self_m < twice.self_m


def test_singularities_and_windows_have_margins_of_their_own() -> None:
    near, late = at_least("singularity_distance", 0.04, 0.05, "1"), at_most("landing_window", 6e-3, 5e-3, "m")
    wide = CLOSE.widened([near, late])
    assert wide is not None
    assert wide.singularity > CLOSE.singularity + 0.2
    assert wide.window < CLOSE.window * 5.0 / 6.0
    assert wide.held == frozenset()


@pytest.mark.parametrize(
    "failure",
    [
        at_most("joint_velocity", 4.0, 3.0, "rad/s"),  # not for want of looking
        at_most("joint_torque", 400.0, 150.0, "Nm"),  # no margin helps
        at_least("keep_out", -0.5, 0.02, "m"),
    ],
)
def test_some_failures_have_no_remedy(failure: Check) -> None:
    assert CLOSE.widened([failure]) is None
