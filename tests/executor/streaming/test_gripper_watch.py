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
