"""The approach, streamed by the loop itself: to an arm that is late, does not follow, or stands somewhere else."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from executor import shared_memory as shm
from executor.preparation import prepare_job
from executor.streaming.approach import START_RAD, approach, take_object
from executor.streaming.loop import ARRIVED_RAD
from planner.approach import find_approach
from tests.executor.conftest import Prepared, settings
from tests.executor.streaming.test_landing_watch import OffArm

AWAY = np.array([0.8, 0.2, -0.2, 0.1, 0.3, 0.0])  # [rad] from where the plan begins
NOBODY = SimpleNamespace(pending=lambda: None)


def arm_away(prepared: Prepared, lag_s: float, gain: float = 1.0, pace: float = 1.0) -> OffArm:
    """An arm at rest, away from the plan's start, and a job that leads there."""
    cell = prepared.cell
    start = prepared.trajectory.q[0]
    way, failures = find_approach(cell, start + AWAY, start, pace)
    assert way is not None and way.is_straight, failures
    job = prepare_job(prepared.problem, prepared.trajectory, way, "speedj", False, settings(cell.name))
    arm = OffArm(job, lag_s, np.full(6, gain))
    arm.true_q = start + AWAY
    arm.q = arm.true_q.tolist()
    return arm


@pytest.mark.parametrize(("lag_s", "gain"), [(0.02, 0.97), (0.02, 1.03), (0.1, 1.0)])
def test_an_arm_arrives_however_late_and_off_its_speed(prepared: Prepared, lag_s: float, gain: float) -> None:
    arm = arm_away(prepared, lag_s, gain)
    assert approach(arm, NOBODY) is None
    assert np.abs(arm.true_q - prepared.trajectory.q[0]).max() < ARRIVED_RAD
    assert np.abs(arm.true_qd).max() < 0.01
    assert not arm.opened


def test_an_approach_ends_with_its_last_row_where_the_arm_has_arrived(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    approach(arm, NOBODY)
    assert arm.tick <= len(arm.job.approach.q) + 1


def test_an_arm_that_does_not_follow_is_stopped(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02, gain=0.5)
    outcome, reason = approach(arm, NOBODY)
    assert outcome == "tracking", reason
    assert arm.sent[-1] == pytest.approx(np.zeros(6), abs=arm.job.feedback_max + 1e-6)


def test_an_arm_that_was_moved_meanwhile_is_refused_at_rest(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    arm.q[2] += 2.0 * START_RAD
    outcome, reason = approach(arm, NOBODY)
    assert outcome == "refused"
    assert "was moved by 0.020 rad" in reason
    assert not arm.sent


def test_at_the_start_nothing_moves(prepared: Prepared) -> None:
    arm = OffArm(prepared.job, 0.02, np.ones(6))
    arm.q = list(prepared.job.q[0])
    assert approach(arm, NOBODY) is None
    assert not arm.sent


def test_an_abort_on_the_way_brakes(prepared: Prepared) -> None:
    arm = arm_away(prepared, 0.02)
    requests = SimpleNamespace(pending=lambda: ("aborted", "abort requested") if arm.tick * arm.job.dt > 0.6 else None)
    assert approach(arm, requests) == ("aborted", "abort requested")
    fastest = max(max(map(abs, qd)) for qd in arm.sent)
    assert fastest > 0.5
    assert np.abs(arm.true_qd).max() < 0.01
    assert arm.tick * arm.job.dt < 0.6 + 0.1


TAKES_S = 0.12  # [s] from the gripper's command until the sensor shows the object


class GrippingArm(OffArm):
    """An arm at rest whose gripper follows its output at once, and has an object some time later, or never."""

    def __init__(self, prepared: Prepared, has_object: bool, is_open: bool = True, **changes: object) -> None:
        super().__init__(replace(prepared.job, grip_input=4, close_s=0.2, **changes), 0.02, np.ones(6))
        self.has_object = has_object
        self.q = list(prepared.job.q[0])
        self.bit = 1 << 16 + self.job.output_index
        self.outputs = self.bit if is_open == self.job.output_level else 0
        self.inputs = 0 if is_open or not has_object else 1 << 4
        self.told = []
        self.closed_at = None

    def output(self, kind: str, index: int, level: bool) -> None:
        opens = level == self.job.output_level
        self.told.append(opens)
        self.outputs = self.bit if level else 0
        self.closed_at = None if opens else self.tick * self.job.dt

    def read(self) -> None:
        if self.closed_at is not None and self.has_object and self.tick * self.job.dt > self.closed_at + TAKES_S:
            self.inputs = 1 << 4


def test_what_a_gripper_closes_on_is_carried(prepared: Prepared) -> None:
    arm = GrippingArm(prepared, has_object=True)
    assert take_object(arm, NOBODY) is None
    assert arm.told == [False]
    assert arm.memory.fields[shm.GRIP] == shm.GRIP_HELD
    assert arm.tick * arm.job.dt >= arm.job.close_s  # it is given its time, as the object may still shift


def test_a_gripper_that_closes_on_nothing_is_a_refusal_and_opened_again(prepared: Prepared) -> None:
    arm = GrippingArm(prepared, has_object=False)
    assert take_object(arm, NOBODY) == ("refused", "the gripper closed on nothing: input 4 is low")
    assert arm.told == [False, True]
    assert arm.memory.fields[shm.GRIP] == shm.GRIP_REOPENED
    assert not arm.sent


def test_a_closed_gripper_without_an_object_is_a_refusal_and_left_alone(prepared: Prepared) -> None:
    arm = GrippingArm(prepared, has_object=False, is_open=False)
    reason = "the gripper is closed and holds nothing: input 4 is low"
    assert take_object(arm, NOBODY) == ("refused", reason)
    assert arm.told == []
    assert arm.memory.fields[shm.GRIP] == shm.GRIP_EMPTY
    assert take_object(GrippingArm(prepared, has_object=True, is_open=False), NOBODY) is None


def test_a_gripper_that_has_not_let_go_is_a_refusal(prepared: Prepared) -> None:
    arm = GrippingArm(prepared, has_object=True)
    arm.inputs = 1 << 4
    assert take_object(arm, NOBODY) == ("refused", "the gripper still holds an object: input 4 is high")
    assert arm.told == []


@pytest.mark.parametrize("changes", [{"output_row": -1}, {"dry_run": True}])
def test_a_run_that_lets_go_of_nothing_needs_no_object(prepared: Prepared, changes: dict[str, object]) -> None:
    arm = GrippingArm(prepared, has_object=False, **changes)
    assert take_object(arm, NOBODY) is None
    assert arm.told == []
    assert arm.memory.fields[shm.GRIP] == shm.GRIP_UNSEEN


def test_a_grip_that_nobody_can_see_is_not_judged(prepared: Prepared) -> None:
    arm = GrippingArm(prepared, has_object=False)
    arm.job = replace(arm.job, grip_input=None)
    assert take_object(arm, NOBODY) is None
    assert arm.memory.fields[shm.GRIP] == shm.GRIP_UNSEEN


def test_an_approach_of_speeds_that_is_ended_early_ends_its_stream_before_another_kind(prepared: Prepared) -> None:
    """A stop of servoing beside a stream of speeds is an error of the controller's program."""
    arm = arm_away(prepared, 0.02)
    arm.job = replace(arm.job, mode="servoj")
    ended = []
    arm.end_speeds = lambda: ended.append(arm.tick)
    stopped = SimpleNamespace(pending=lambda: ("aborted", "abort requested") if arm.tick > 20 else None)
    assert approach(arm, stopped) == ("aborted", "abort requested")
    assert len(ended) == 1
