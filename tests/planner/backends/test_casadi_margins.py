"""Margins widened from a certificate's failed checks."""

from __future__ import annotations

import pytest

from planner.backends.casadi_nlp import DEFAULT_MARGINS, Margins, meets_arm
from planner.backends.casadi_nlp.layout import LAZY_GROUPS
from planner.backends.casadi_nlp.margins import GROUPS, POSITIONS
from planner.certificate import Check
from planner.certificate.certificate import at_least, at_most


def widened(*failures: Check, margins: Margins = DEFAULT_MARGINS, speed: float = 1.0) -> Margins | None:
    return margins.widened(failures, lambda _at_s: speed)


def test_what_is_missing_is_added_with_some_more() -> None:
    wide = widened(
        at_least("floor", 0.012, 0.02, "m", 0.12),
        at_most("joint_torque", 165.0, 150.0, "Nm", 0.18),
        at_least("joint_position", -1.68, -1.66, "rad", 0.1),
        at_most("landing_window", 6e-3, 5e-3, "m"),
    )
    assert wide is not None
    assert DEFAULT_MARGINS.floor_m + 0.008 < wide.floor_m < DEFAULT_MARGINS.floor_m + 0.016
    assert 0.1 < DEFAULT_MARGINS.torque - wide.torque < 0.12
    assert 0.02 < wide.position_rad < 0.04
    assert 0.1 < DEFAULT_MARGINS.window - wide.window < 0.2  # bounded in x and in y
    assert wide.widened_groups == {"clearance", "effort", "positions"}


def test_each_failure_adds_to_the_one_before() -> None:
    failure = at_least("self_collision", 0.004, 0.005, "m", 0.1)
    once = widened(failure)
    assert once is not None
    twice = widened(failure, margins=once)
    assert twice is not None
    assert twice.self_m - once.self_m == pytest.approx(once.self_m - DEFAULT_MARGINS.self_m)


def test_a_singularity_is_passed_farther_away() -> None:
    wide = widened(at_least("singularity_distance", 0.04, 0.05, "1"))
    assert wide is not None
    assert 0.2 < wide.singularity - DEFAULT_MARGINS.singularity < 0.25


@pytest.mark.parametrize(
    "failure",
    [
        at_most("joint_velocity", 4.0, 3.0, "rad/s", 0.1),  # enforced between the knots, too
        at_most("joint_torque", 400.0, 150.0, "Nm", 0.1),  # no margin helps
        at_most("landing_window", 0.2, 5e-3, "m", 0.1),
    ],
)
def test_some_failures_have_no_remedy(failure: Check) -> None:
    assert widened(failure) is None


@pytest.mark.parametrize(
    ("what", "names"),
    [("box 0", {"flight_m", "mouth_m"}), ("forearm", {"passing_m"}), ("foot", {"standing_m"})],
)
def test_a_flight_keeps_farther_from_what_it_meets(what: str, names: set[str]) -> None:
    failure = at_least("flight_clearance", -0.01, 0.0, "m", 0.2, what)
    assert meets_arm(failure) == (names == {"passing_m"})
    wide = widened(failure)
    assert wide is not None
    changed = {name for name in vars(wide) if getattr(wide, name) != getattr(DEFAULT_MARGINS, name)}
    assert changed == names
    assert all(getattr(wide, name) > getattr(DEFAULT_MARGINS, name) + 0.01 for name in names)


@pytest.mark.parametrize("missing_rad", [0.01, 0.1, 1.5])
def test_an_object_that_leaves_into_the_palm_is_followed_out_of_the_grip(missing_rad: float) -> None:
    following = widened(at_most("opening_direction", 1.2 + missing_rad, 1.2, "rad", 0.1))
    assert following is not None
    assert following.leaves
    assert following.widened_groups == {"flight", "leaving"}


def test_where_it_is_followed_a_missing_angle_narrows_the_cone() -> None:
    following = Margins(leaves=True)
    narrower = widened(at_most("opening_direction", 1.3, 1.2, "rad", 0.1), margins=following)
    assert narrower is not None
    assert 0.15 < narrower.opening_rad - DEFAULT_MARGINS.opening_rad < 0.2


@pytest.mark.parametrize(("name", "share"), [("stopping_time", 0.8), ("stopping_distance", 0.8**0.5), ("power", 0.8)])
def test_what_only_the_safety_system_watches_makes_the_tool_slower(name: str, share: float) -> None:
    slower = widened(at_most(name, 0.5, 0.4, "1", 0.1), speed=0.6)
    assert slower is not None
    assert 0.6 * (share - 0.02) < slower.tcp_speed < 0.6 * share
    assert slower.widened_groups == {"effort"}
    assert widened(at_most(name, 1e5, 0.4, "1", 0.1), speed=0.6) is None


def test_margins_belong_to_groups_of_rows() -> None:
    assert set(GROUPS) == {*LAZY_GROUPS, POSITIONS}
    of_groups = {name for names in GROUPS.values() for name in names}
    assert of_groups == set(vars(DEFAULT_MARGINS)) - {"window", "singularity", "heeds_shapes"}
