"""Margins widened from a certificate's failed checks."""

from __future__ import annotations

import numpy as np
import pytest

from planner.backends.casadi_nlp import DEFAULT_MARGINS, FlightEdge, Margins, meets_arm, meets_base, too_coarse
from planner.certificate import Check
from planner.certificate.certificate import at_least, at_most
from planner.solution import Solution
from planner.trajectory import Trajectory

ZEROS = np.zeros((101, 6))
SOLUTION = Solution(Trajectory(500.0, ZEROS, ZEROS, ZEROS, 80), "", held=frozenset({"effort"}))  # 0.16 s and 0.2 s


def test_what_is_missing_is_added_at_its_time() -> None:
    wide = DEFAULT_MARGINS.widened(
        [at_least("floor", 0.012, 0.02, "m", 0.12), at_most("joint_torque", 165.0, 150.0, "Nm", 0.18)], SOLUTION
    )
    assert wide is not None
    floor, torque = wide.local
    assert (floor.check, floor.phase) == ("floor", pytest.approx(0.75))
    assert 0.008 < floor.amount < 0.016
    assert (torque.check, torque.phase) == ("joint_torque", pytest.approx(1.5))
    assert 0.1 < torque.amount < 0.12
    assert wide.held == {"clearance", "effort"}


def test_each_failure_adds_to_the_one_before() -> None:
    once = DEFAULT_MARGINS.widened([at_most("joint_torque", 165.0, 150.0, "Nm", 0.1)], SOLUTION)
    assert once is not None
    twice = once.widened([at_most("joint_torque", 155.0, 150.0, "Nm", 0.14)], SOLUTION)
    assert twice is not None
    assert len(twice.local) == 2


def test_a_clearance_that_fails_again_at_another_time_is_widened_everywhere() -> None:
    once = DEFAULT_MARGINS.widened([at_least("self_collision", 0.004, 0.005, "m", 0.1)], SOLUTION)
    assert once is not None
    twice = once.widened([at_least("self_collision", 0.004, 0.005, "m", 0.14)], SOLUTION)
    assert twice is not None
    assert twice.local == once.local
    assert twice.self_m >= DEFAULT_MARGINS.self_m + 0.001


def test_singularities_windows_and_positions_have_margins_of_their_own() -> None:
    near = at_least("singularity_distance", 0.04, 0.05, "1")
    late = at_most("landing_window", 6e-3, 5e-3, "m")
    turned = at_least("joint_position", -1.68, -1.66, "rad", 0.1)
    wide = DEFAULT_MARGINS.widened([near, late, turned], SOLUTION)
    assert wide is not None
    assert 0.02 < wide.position_rad < 0.04
    assert wide.singularity < DEFAULT_MARGINS.singularity + 0.02  # its stages may not have lasted
    assert wide.watched
    assert wide.window < DEFAULT_MARGINS.window * 5.0 / 6.0
    assert wide.held == SOLUTION.held
    wider = wide.widened([near], SOLUTION)
    assert wider is not None
    assert wider.singularity > DEFAULT_MARGINS.singularity + 0.2


@pytest.mark.parametrize(
    "failure",
    [
        at_most("joint_velocity", 4.0, 3.0, "rad/s", 0.1),  # enforced between the knots, too
        at_most("joint_torque", 400.0, 150.0, "Nm", 0.1),  # no margin helps
        at_least("keep_out", -0.5, 0.02, "m", 0.1),
        at_most("landing_window", 0.2, 5e-3, "m", 0.1),
    ],
)
def test_some_failures_have_no_remedy(failure: Check) -> None:
    assert DEFAULT_MARGINS.widened([failure], SOLUTION) is None


def test_a_clearance_violated_by_much_calls_for_more_stages() -> None:
    assert too_coarse([at_most("joint_torque", 165.0, 150.0, "Nm", 0.18), at_least("floor", 0.014, 0.02, "m", 0.12)])
    assert not too_coarse([at_least("floor", 0.0155, 0.02, "m", 0.12), at_most("tcp_speed", 5.0, 4.0, "m/s", 0.1)])


def test_a_clearance_that_fails_beside_its_margin_calls_for_more_stages() -> None:
    again = at_least("floor", 0.019, 0.02, "m", 0.12)
    once = DEFAULT_MARGINS.widened([again], SOLUTION)
    assert once is not None
    assert not too_coarse([again])
    assert too_coarse([again], once)
    assert not too_coarse([at_least("keep_out", 0.019, 0.02, "m", 0.12)], once)


def test_more_stages_begin_with_the_rows_of_the_solution_and_of_its_failed_checks() -> None:
    before = Margins(held=frozenset({"grip"}))
    held = before.holding([at_least("floor", 0.01, 0.02, "m", 0.1), at_least("release", 0.0, 1.0, "1", 0.1)], SOLUTION)
    assert held == Margins(held=frozenset({"grip", "effort", "clearance"}))


def test_a_flight_that_meets_a_box_passes_it_with_more_room() -> None:
    wide = DEFAULT_MARGINS.widened([at_least("flight_clearance", -0.01, 0.0, "m", 0.2)], SOLUTION)
    assert wide is not None
    assert wide.flight_m > DEFAULT_MARGINS.flight_m + 0.01
    assert "flight" in wide.held


def test_a_flight_that_meets_the_arm_is_cut() -> None:
    cut = FlightEdge.at_time(0.3, (0.0, 0.0, 1.0), 0.5)
    failure = at_least("flight_clearance", -0.01, 0.0, "m", 0.2)
    once = DEFAULT_MARGINS.widened([failure], SOLUTION, (cut,))
    assert once is not None
    assert (once.cuts, once.flight_m) == ((cut,), DEFAULT_MARGINS.flight_m)
    twice = once.widened([failure], SOLUTION, (cut,))
    assert twice is not None
    assert len(twice.cuts) == 2


def test_a_flight_that_meets_a_link_is_passed_by_the_braking_arm_with_more_room() -> None:
    beside_link = at_least("flight_clearance", -0.01, 0.0, "m", 0.2, "forearm")
    assert meets_arm(beside_link)
    wide = DEFAULT_MARGINS.widened([beside_link], SOLUTION)
    assert wide is not None
    assert wide.passing_m > DEFAULT_MARGINS.passing_m + 0.01
    assert wide.flight_m == DEFAULT_MARGINS.flight_m
    assert "passing" in wide.held
    assert not any(meets_arm(at_least("flight_clearance", -0.01, 0.0, "m", 0.2, what)) for what in ("box 0", "foot"))


def test_a_flight_that_meets_the_foot_keeps_off_it_with_more_room() -> None:
    beside_foot = at_least("flight_clearance", -0.01, 0.0, "m", 0.2, "foot")
    wide = DEFAULT_MARGINS.widened([beside_foot], SOLUTION)
    assert wide is not None
    assert wide.standing_m > DEFAULT_MARGINS.standing_m + 0.01
    assert (wide.passing_m, wide.flight_m) == (DEFAULT_MARGINS.passing_m, DEFAULT_MARGINS.flight_m)
    assert "standing" in wide.held
    assert not any(meets_base(at_least("flight_clearance", -0.01, 0.0, "m", 0.2, what)) for what in ("box 0", "elbow"))


@pytest.mark.parametrize("missing_rad", [0.01, 0.1, 1.5])
def test_an_object_that_leaves_into_the_palm_is_followed_out_of_the_grip(missing_rad: float) -> None:
    following = DEFAULT_MARGINS.widened([at_most("opening_direction", 1.2 + missing_rad, 1.2, "rad", 0.1)], SOLUTION)
    assert following is not None
    assert following.leaves
    assert following.held == SOLUTION.held | {"flight", "leaving"}
    assert following.opening_rad > DEFAULT_MARGINS.opening_rad


@pytest.mark.parametrize(("name", "share"), [("stopping_time", 0.8), ("stopping_distance", 0.8**0.5), ("power", 0.8)])
def test_what_only_the_safety_system_watches_makes_the_tool_slower(name: str, share: float) -> None:
    failure = at_most(name, 0.5, 0.4, "1", 0.1)
    slower = DEFAULT_MARGINS.widened([failure], SOLUTION, tool_speed=lambda at_s: 6.0 * at_s)
    assert slower is not None
    assert 0.6 * (share - 0.02) < slower.tcp_speed < 0.6 * share
    assert "effort" in slower.held
    assert DEFAULT_MARGINS.widened([failure], SOLUTION) is None
    assert DEFAULT_MARGINS.widened([at_most(name, 2.0, 0.4, "1", 0.1)], SOLUTION, tool_speed=lambda _: 0.6) is None


def test_where_it_is_followed_a_missing_angle_narrows_the_cone() -> None:
    following = Margins(leaves=True, opening_rad=0.1)
    narrower = following.widened([at_most("opening_direction", 1.3, 1.2, "rad", 0.1)], SOLUTION)
    assert narrower is not None
    assert 0.3 < narrower.opening_rad < 0.5
    assert following.widened([at_most("opening_direction", 1.9, 1.2, "rad", 0.1)], SOLUTION) is None


def test_a_joint_beyond_what_self_collision_blocks_turns_less_far() -> None:
    failure = at_least("self_collision", 0.0049, 0.005, "m", 0.1, "wrist_1, tool_0")
    wide = DEFAULT_MARGINS.widened([failure], SOLUTION, beyond_rad=0.02)
    assert wide is not None
    assert 0.02 < wide.position_rad - DEFAULT_MARGINS.position_rad < 0.04
    assert wide.local == ()
    assert "positions" in wide.held
    within = DEFAULT_MARGINS.widened([failure], SOLUTION, beyond_rad=-0.02)
    assert within is not None
    assert within.position_rad == DEFAULT_MARGINS.position_rad
    assert len(within.local) == 1
    assert DEFAULT_MARGINS.widened([failure], SOLUTION, beyond_rad=0.5) is None
