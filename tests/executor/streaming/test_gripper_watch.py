"""The gripper, told and seen: on its way, deaf, or switched by another client."""

from __future__ import annotations

from dataclasses import replace

import pytest

from executor.streaming.gripper_watch import ANSWER_S, GripperWatch
from tests.executor.conftest import Prepared


@pytest.fixture
def watched(prepared: Prepared) -> tuple[GripperWatch, float]:
    """A watch, and the time within which an output answers."""
    return GripperWatch(prepared.job), prepared.job.lag_ticks * prepared.job.dt + ANSWER_S


def test_a_closed_gripper_that_opens_by_itself_is_released_early(watched: tuple[GripperWatch, float]) -> None:
    watch, _ = watched
    assert watch.look(False, 1.0) is None
    assert watch.look(True, 1.002)[0] == "released_early"


def test_an_output_that_does_as_it_is_told_is_in_order(watched: tuple[GripperWatch, float]) -> None:
    watch, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(False, 1.0 + 0.9 * answer_s) is None  # on its way
    assert watch.look(True, 1.0 + answer_s) is None
    assert watch.look(True, 9.0) is None
    assert watch.look(False, 9.002) == ("not_released", "another client closed the gripper before the object left")


def test_a_deaf_output_is_told(watched: tuple[GripperWatch, float]) -> None:
    watch, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(False, 1.0 + answer_s) is None
    outcome, reason = watch.look(False, 1.002 + answer_s)
    assert (outcome, "did not change" in reason) == ("not_released", True)


def test_an_opening_that_was_taken_back_may_still_show(watched: tuple[GripperWatch, float]) -> None:
    watch, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(False, 1.01) is None
    watch.tell(False, 1.01)
    assert watch.look(False, 1.012) is None
    assert watch.look(True, 1.02) is None  # our own opening, late
    assert watch.look(False, 1.03) is None
    assert watch.look(False, 1.02 + answer_s) is None
    assert watch.look(True, 1.022 + answer_s)[0] == "released_early"


def test_a_gripper_that_reports_nothing_is_never_blamed(watched: tuple[GripperWatch, float]) -> None:
    watch, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(None, 1.002 + answer_s) is None
    assert not watch.is_open


def test_a_gripper_with_a_link_is_given_the_time_that_it_takes_to_open(prepared: Prepared) -> None:
    watch = GripperWatch(replace(prepared.job, opens_in_s=0.2))
    watch.tell(True, 1.0)
    assert watch.look(False, 1.0 + prepared.job.lag_ticks * prepared.job.dt + ANSWER_S + 0.19) is None
    assert watch.look(False, 1.0 + prepared.job.lag_ticks * prepared.job.dt + ANSWER_S + 0.21)[0] == "not_released"


@pytest.fixture
def sensed(prepared: Prepared) -> GripperWatch:
    """A watch of a gripper whose object an input shows, and has shown."""
    return GripperWatch(replace(prepared.job, grip_input=4), held=True)


def test_an_object_that_slips_out_is_released_early(sensed: GripperWatch) -> None:
    assert sensed.look(False, 1.0, True) is None
    told = ("released_early", "the object slipped out of the gripper: input 4 went low")
    assert sensed.look(False, 1.002, False) == told


def test_an_object_that_leaves_a_gripper_that_was_told_to_open_is_in_order(sensed: GripperWatch) -> None:
    sensed.tell(True, 1.0)
    assert sensed.look(False, 1.002, False) is None  # it lets go sooner than its output shows
    assert sensed.look(True, 1.03, False) is None
    sensed.tell(False, 1.032)  # too late: a stop does not hold what has left
    assert sensed.look(False, 1.2, False) is None


def test_what_was_never_seen_held_is_not_lost(prepared: Prepared) -> None:
    """A way without a throw may be made with an empty gripper that is closed; or with an object, which is watched."""
    watch = GripperWatch(replace(prepared.job, grip_input=4))
    assert watch.look(False, 1.0, False) is None
    assert watch.look(False, 1.002, True) is None
    assert watch.look(False, 1.004, False)[0] == "released_early"


def test_what_a_gripper_reports_of_its_object_is_left_to_its_driver(prepared: Prepared) -> None:
    watch = GripperWatch(prepared.job, held=True)
    assert watch.look(False, 1.0, False) is None
