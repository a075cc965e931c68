"""The gripper's output, told and seen: on its way, deaf, or switched by another client."""

from __future__ import annotations

from dataclasses import replace

import pytest

from executor.streaming.gripper_watch import ANSWER_S, GripperWatch
from tests.executor.conftest import Prepared

KINDS = [("standard_digital", 3, 1 << 3), ("configurable_digital", 2, 1 << 10), ("tool_digital", 1, 1 << 17)]


@pytest.fixture(params=KINDS, ids=lambda kind: kind[0])
def watched(prepared: Prepared, request: pytest.FixtureRequest) -> tuple[GripperWatch, int, float]:
    """A watch, the bit that opens the gripper, and the time within which an output answers."""
    output, index, bit = request.param
    job = replace(prepared.job, output=output, output_index=index, output_level=True)
    return GripperWatch(job), bit, job.lag_ticks * job.dt + ANSWER_S


def test_a_closed_gripper_that_opens_by_itself_is_released_early(watched: tuple[GripperWatch, int, float]) -> None:
    watch, bit, _ = watched
    assert watch.look(~bit, 1.0) is None
    assert watch.look(bit, 1.002)[0] == "released_early"


def test_an_output_that_does_as_it_is_told_is_in_order(watched: tuple[GripperWatch, int, float]) -> None:
    watch, bit, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(0, 1.0 + 0.9 * answer_s) is None  # on its way
    assert watch.look(bit, 1.0 + answer_s) is None
    assert watch.look(bit, 9.0) is None
    assert watch.look(0, 9.002) == ("not_released", "another client closed the gripper before the object left")


def test_a_deaf_output_is_told(watched: tuple[GripperWatch, int, float]) -> None:
    watch, _, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(0, 1.0 + answer_s) is None
    outcome, reason = watch.look(0, 1.002 + answer_s)
    assert (outcome, "did not change" in reason) == ("not_released", True)


def test_an_opening_that_was_taken_back_may_still_show(watched: tuple[GripperWatch, int, float]) -> None:
    watch, bit, answer_s = watched
    watch.tell(True, 1.0)
    assert watch.look(0, 1.01) is None
    watch.tell(False, 1.01)
    assert watch.look(0, 1.012) is None
    assert watch.look(bit, 1.02) is None  # our own opening, late
    assert watch.look(0, 1.03) is None
    assert watch.look(0, 1.02 + answer_s) is None
    assert watch.look(bit, 1.022 + answer_s)[0] == "released_early"


def test_the_level_that_opens_may_be_low(prepared: Prepared) -> None:
    job = replace(prepared.job, output="standard_digital", output_index=0, output_level=False)
    watch = GripperWatch(job)
    assert watch.look(1, 1.0) is None
    assert watch.look(0, 1.1)[0] == "released_early"
