"""What became of an object, read from the states of the controller."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from executor.lost_object import object_words
from executor.robot import RATE_HZ, RobotState
from executor.streaming.state_checks import OUTPUT_SHIFT
from tests.executor.conftest import Prepared

AT_ZERO_S = 50.0  # [s] the controller's time at plan time 0


def published(prepared: Prepared, opened_s: float, closed_s: float) -> list[RobotState]:
    """States of an arm that follows the plan, with the gripper's output open between two plan times [s]."""
    bit = 1 << (OUTPUT_SHIFT[prepared.cell.gripper.output] + prepared.cell.gripper.index)
    states = []
    for t in np.arange(0.0, prepared.trajectory.duration_s, 1.0 / RATE_HZ):
        q, qd, _ = (x[0] for x in prepared.trajectory.at(np.array([t])))
        outputs = bit if opened_s <= t < closed_s else 0
        states.append(
            RobotState(time.monotonic(), AT_ZERO_S + t, tuple(q), tuple(qd), (0.0,) * 6, 7, 1, 2, 1.0, outputs)
        )
    return states


def words(prepared: Prepared, opened_s: float, closed_s: float = np.inf, was_told: bool = True) -> str:
    states = published(prepared, opened_s, closed_s)
    return object_words(prepared.problem, prepared.trajectory, states, was_told)


def test_a_release_as_planned_lands_as_planned(prepared: Prepared) -> None:
    delay = prepared.cell.gripper.delay_s
    text = words(prepared, prepared.trajectory.release_time_s - delay)
    x, y, z = (float(number) for number in re.search(r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\)", text).groups())
    assert np.array([x, y, z]) == pytest.approx([1.2, 0.3, 0.0], abs=0.05)
    assert text.startswith("the object left the gripper")


def test_a_release_too_early_lands_elsewhere(prepared: Prepared) -> None:
    text = words(prepared, prepared.trajectory.release_time_s - prepared.cell.gripper.delay_s - 0.06)
    off = float(re.search(r"([\d.]+) m from where", text).group(1))
    assert off > 0.2


def test_an_object_that_was_held_in_time_is_held(prepared: Prepared) -> None:
    opened = prepared.trajectory.release_time_s - prepared.cell.gripper.delay_s
    assert "the object is held" in words(prepared, opened, opened + 0.02)
    assert "may have left" in words(prepared, opened, opened + prepared.cell.gripper.delay_s)


def test_a_gripper_that_never_opened_is_told_only_where_it_should_have(prepared: Prepared) -> None:
    assert words(prepared, np.inf, was_told=False) == ""
    assert "stayed closed: the object is held" in words(prepared, np.inf)
    states = published(prepared, np.inf, np.inf)
    held = object_words(prepared.problem, prepared.trajectory, states, True, stayed_closed=True)
    assert held == "the object is held"  # the reason of the run's end says the rest
    assert "may have left" in object_words(prepared.problem, prepared.trajectory, [], True)
    seen_long_ago = [replace(state, seen_at=state.seen_at - 5.0) for state in published(prepared, np.inf, np.inf)]
    assert "cannot be seen" in object_words(prepared.problem, prepared.trajectory, seen_long_ago, True)


def test_an_object_that_slips_out_lands_from_where_the_input_went_low(prepared: Prepared) -> None:
    """What the input does at rest, while the gripper closes, is no loss; nor is the next object a return."""
    gripper = replace(prepared.cell.gripper, grip_input=4)
    problem = replace(prepared.problem, cell=replace(prepared.cell, gripper=gripper))
    slipped_s = prepared.trajectory.release_time_s
    states = []
    for state in published(prepared, np.inf, np.inf):
        t = state.timestamp_s - AT_ZERO_S
        states.append(replace(state, inputs=0 if slipped_s <= t < slipped_s + 0.1 else 1 << 4))
    at_rest = [replace(states[0], inputs=inputs, timestamp_s=AT_ZERO_S - 0.01) for inputs in (1 << 4, 0)]
    text = object_words(problem, prepared.trajectory, at_rest + states, was_told=False)
    x, y, _ = (float(number) for number in re.search(r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\)", text).groups())
    assert (x, y) == pytest.approx((1.2, 0.3), abs=0.08)  # let go where the plan does, known to a state
    assert object_words(prepared.problem, prepared.trajectory, states, was_told=False) == ""


def test_without_a_state_nobody_knows(prepared: Prepared) -> None:
    """A gripper on a network was told to open, and the controller published nothing meanwhile."""
    link: Any = "a gripper on a network"
    cell = replace(prepared.cell, gripper=replace(prepared.cell.gripper, link=link))
    problem = replace(prepared.problem, cell=cell)
    opened = AT_ZERO_S + prepared.trajectory.release_time_s
    long_ago = [each for each in published(prepared, 9.0, 9.0) if each.timestamp_s < opened - 0.6]
    assert not long_ago or long_ago[-1].timestamp_s > AT_ZERO_S
    for states in ([], long_ago):
        text = object_words(problem, prepared.trajectory, states, True, (opened, None))
        assert "cannot be seen any more: the object may have left" in text
        text = object_words(problem, prepared.trajectory, states, True, (opened, opened + 0.001))
        assert "the object is held" in text
