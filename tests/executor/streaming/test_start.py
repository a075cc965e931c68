"""The wait for a tick at the plan's start, and another plan that takes the place of the one that waits."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import orjson
import pytest

from executor import shared_memory as shm
from executor.execution import Execution
from executor.preflight import ExecutionRefused
from executor.preparation import prepare_job
from executor.replacement import Motion, Question, Replacement, answer
from executor.shared_memory import SharedMemory
from executor.stream_job import NOT_IN_MOTION, StreamJob
from executor.streaming.loop import Schedule, Stream
from executor.streaming.start import AHEAD, await_start, first_row_s
from planner.answer import plan_document
from planner.planning import Plan, plan
from planner.request import problem_from_request
from planner.stream_rows import lead_in_s
from tests.executor.conftest import settings
from tests.planner.problems import cell

SETTINGS = settings()
SEEN_S = 1000.0
BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
HELD = np.zeros(3)


def request(speed_m_s: float = 0.3, not_before_s: float = SEEN_S + 1.0, **more: Any) -> dict[str, Any]:
    release = {"kind": "target", "position": [1.1, -0.6, 0.0], "opening": BIN, "observed_at_s": SEEN_S}
    release["velocity"] = [0.0, speed_m_s, 0.0]
    return {"release": release, "starts_not_before_s": not_before_s, **more}


@cache
def found(speed_m_s: float = 0.3, not_before_s: float = SEEN_S + 1.0) -> Plan:
    return plan(problem_from_request(request(speed_m_s, not_before_s), cell()))


def motion_of(made: Plan) -> Motion:
    return Motion(made.problem, made.trajectory, HELD)


@cache
def job() -> StreamJob:
    motion = motion_of(found())
    return prepare_job(motion.problem, motion.trajectory, None, "speedj", False, SETTINGS)


def answered(asked: dict[str, Any], made: Plan) -> Replacement | str:
    document = orjson.dumps(plan_document(made, asked, "p", ""), option=orjson.OPT_SERIALIZE_NUMPY)
    question = Question("e", document, cell(), None, motion_of(found()), job().packed(), -1, SETTINGS, waits=True)
    return answer(question)


@cache
def other() -> Replacement:
    made = answered(request(0.31), found(0.31))
    assert isinstance(made, Replacement), made
    return made


class StandingGripper:
    def cycle(self) -> None:
        pass


class StandingArm:
    """A controller whose time goes on by a tick whenever it is asked for."""

    def __init__(self, memory: SharedMemory, begins_s: float, dt: float) -> None:
        self.memory = memory
        self.stamp = begins_s
        self.dt = dt
        self.gripper = StandingGripper()
        self.offers: dict[int, bytes] = {}  # after so many ticks
        self.ticks = 0

    def timestamp(self) -> float:
        self.stamp += self.dt
        return self.stamp

    def read(self) -> None:
        self.ticks += 1
        if self.ticks in self.offers:
            self.memory.offer(self.offers[self.ticks], 0)

    def check(self) -> None:
        pass

    def speed(self, qd: list[float]) -> None:
        assert qd == [0.0] * 6


class NoRequests:
    def pending(self) -> None:
        return None


@pytest.fixture
def memory() -> Iterator[SharedMemory]:
    made = SharedMemory.create(10)
    yield made
    made.close()


def waited(memory: SharedMemory, offers: dict[int, bytes], waits_ticks: int = 200) -> tuple[StandingArm, Any, Any]:
    due_s = first_row_s(job())
    assert due_s is not None
    arm = StandingArm(memory, due_s - waits_ticks * job().dt, job().dt)
    arm.offers = offers
    taken, early = await_start(arm, job(), NoRequests())  # type: ignore[arg-type]
    return arm, taken, early


def test_without_an_offer_it_waits_for_its_own_tick(memory: SharedMemory) -> None:
    arm, taken, early = waited(memory, {})
    due_s = first_row_s(taken)
    assert due_s is not None
    assert taken is job()
    assert early is None
    assert -AHEAD * taken.dt <= arm.stamp - due_s <= 0.5 * taken.dt


def test_the_one_that_is_offered_is_waited_for_instead(memory: SharedMemory) -> None:
    arm, taken, early = waited(memory, {20: other().job})
    due_s = first_row_s(taken)
    assert early is None
    assert due_s is not None
    assert due_s == pytest.approx((found(0.31).problem.starts_at_s or 0.0) - due_offset())
    assert abs(arm.stamp - due_s) <= AHEAD * taken.dt
    assert memory.fields[shm.TAKEN] == memory.fields[shm.ANSWERED] == 1.0
    assert taken.q[0] == pytest.approx(job().q[0])


def due_offset() -> float:
    """Returns how long before a plan's start its first row is sent [s]."""
    due_s = first_row_s(job())
    assert due_s is not None
    return (found().problem.starts_at_s or 0.0) - due_s


def test_one_that_comes_too_late_is_answered_and_not_taken(memory: SharedMemory) -> None:
    past = replace(StreamJob.unpacked(memoryview(other().job)), starts_at_s=SEEN_S - 5.0).packed()
    _, taken, early = waited(memory, {20: past})
    assert early is None
    assert taken is job()
    assert (memory.fields[shm.TAKEN], memory.fields[shm.ANSWERED]) == (0.0, 1.0)


def test_a_stream_that_has_begun_does_not_take_it(memory: SharedMemory) -> None:
    memory.offer(other().job, 0)
    stream = Stream.__new__(Stream)
    stream.fields, stream.memory, stream.recorded = memory.fields, memory, True
    stream.job, stream.schedule, stream.verdict = job(), Schedule(job()), ("completed", "")
    for row in (-1, 0, 5):
        stream._answer_offer(row)
    assert stream.job is job()
    assert (memory.fields[shm.TAKEN], memory.fields[shm.ANSWERED]) == (0.0, 1.0)


def test_what_takes_its_place_is_the_plan_as_a_run_of_its_own() -> None:
    made = StreamJob.unpacked(memoryview(other().job))
    assert made.joins_row == NOT_IN_MOTION
    alone = motion_of(found(0.31))
    own = prepare_job(alone.problem, alone.trajectory, None, "speedj", False, SETTINGS)
    for name in ("q", "qd", "reference_q", "brake_row", "brake_ticks"):
        assert [*getattr(made, name)] == [*getattr(own, name)], name
    assert (made.output_row, made.release_row, made.starts_at_s) == (own.output_row, own.release_row, own.starts_at_s)
    assert other().motion.joins_s == 0.0


def test_a_plan_that_begins_elsewhere_or_at_no_instant_is_refused() -> None:
    start = {"positions": [0.1, -1.57, 1.57, -1.57, -1.57, 0.0]}
    asked = request(start=start)
    elsewhere = answered(asked, plan(problem_from_request(asked, cell())))
    assert isinstance(elsewhere, str)
    assert "0.1 rad from where the arm waits, in joint 1" in elsewhere
    asked = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
    at_once = answered(asked, plan(problem_from_request(asked, cell())))
    assert isinstance(at_once, str)
    assert "waits at its start" in at_once


def test_an_output_before_the_start_is_due_before_the_arm_may_arrive() -> None:
    """The arm that arrives between its first row and the start would be refused at its tick, and was not before."""
    whole = request()
    lamp = {"output": "standard_digital", "index": 0, "level": True, "offset_s": -1.9}
    passage = {"name": "throw", "state": whole.pop("release"), "releases": True, "outputs": [lamp]}
    made = plan(problem_from_request({**whole, "passages": [passage]}, cell()))
    starts_at_s = made.problem.starts_at_s
    assert starts_at_s is not None
    due_s = first_row_s(prepare_job(made.problem, made.trajectory, None, "speedj", False, SETTINGS))
    assert due_s == pytest.approx(starts_at_s - lead_in_s(made.problem, made.trajectory), abs=1e-9)
    assert starts_at_s - due_s > 1.9 - made.trajectory.release_time_s
    row: Any = SimpleNamespace(mode="speedj")
    session: Any = None
    execution = Execution(session, row)
    left_s = 5.0
    state: Any = SimpleNamespace(timestamp_s=due_s - left_s, seen_at=time.monotonic())
    execution._check_start(motion_of(made), state, 0.0)
    with pytest.raises(ExecutionRefused, match=r"^too late: the arm is at the plan's start"):
        execution._check_start(motion_of(made), state, left_s + 0.1)
