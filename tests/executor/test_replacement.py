"""A plan that replaces a running one: joined at a tick, the rows before it unchanged, or refused with the reason."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from functools import cache
from multiprocessing import active_children
from multiprocessing.process import BaseProcess

import numpy as np
import pytest

from executor import replacement
from executor import shared_memory as shm
from executor.preparation import prepare_job
from executor.replacement import CannotJoin, Certifier, Motion, joined, joined_job, joins_row
from executor.shared_memory import SharedMemory
from executor.stream_job import StreamJob
from executor.streaming.loop import Schedule
from planner.passages import OutputSwitch, Passage
from planner.planning import plan
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.executor.conftest import settings
from tests.planner.problems import cell
from tests.waiting import until

SETTINGS = settings()
ASIDE = np.array([0.35, 0.1, -0.15, 0.1, 0.05, 0.2])
HELD = np.zeros(3)
ENDED_S = 30.0  # [s] until a process that was told to has ended, on a busy machine


def rest(name: str, side: float, *outputs: OutputSwitch) -> Passage:
    return Passage(name, JointRelease(cell().home + side * ASIDE, np.zeros(6)), outputs)


def to_and_fro(*passages: Passage, **changes) -> ThrowProblem:
    here = cell()
    limits = replace(here.limits, qd_max=0.5 * here.limits.qd_max)
    start = {"cell": here, "start": here.home, "limits": limits}
    return ThrowProblem(**{**start, "release": passages[-1].state, "passages": passages, **changes})


def motion_of(problem: ThrowProblem) -> Motion:
    return Motion(problem, plan(problem).trajectory, HELD)


def begin_at(motion: Motion, tick: int, *passages: Passage, joins_s: float | None = None) -> Motion:
    """A plan that begins at a tick of a motion."""
    trajectory = motion.trajectory
    state = {"start": trajectory.q[tick], "start_qd": trajectory.qd[tick], "start_qdd": trajectory.qdd[tick]}
    return replace(motion_of(to_and_fro(*(passages or (rest("on", 1.0),)), **state)), joins_s=joins_s)


@cache
def running() -> tuple[Motion, StreamJob]:
    lamp = (OutputSwitch("standard_digital", 1, True), OutputSwitch("standard_digital", 2, True, 0.3))
    motion = motion_of(to_and_fro(rest("a", 1.0, *lamp), rest("b", -1.0)))
    return motion, prepare_job(motion.problem, motion.trajectory, None, "speedj", False, SETTINGS)


def moving_tick(share: float) -> int:
    motion, _ = running()
    return int(share * (len(motion.trajectory.q) - 1))


@pytest.mark.parametrize("share", [0.1, 0.37, 0.61, 0.8])
def test_the_whole_is_one_motion_whose_first_rows_are_the_running_ones(share: float) -> None:
    motion, job = running()
    tick = moving_tick(share)
    present = joins_row(job, tick) - 30
    whole = joined(motion, job, begin_at(motion, tick, rest("on", 0.5), rest("off", -0.5)), present)
    assert whole.joins_s == pytest.approx(tick * motion.trajectory.dt)
    made = joined_job(whole, job, SETTINGS, None, present)
    assert made.q[: made.joins_row] == job.q[: made.joins_row]
    assert made.q[made.joins_row + 5] != job.q[made.joins_row + 5]
    jerk = np.abs(np.diff(whole.trajectory.qdd, axis=0)).max(axis=0) / motion.trajectory.dt
    assert (jerk <= whole.problem.limits.jerk_max * (1.0 + 1e-6)).all()
    states = (whole.trajectory.q, whole.trajectory.qd)
    gap = np.abs(np.diff(states[0], axis=0) - motion.trajectory.dt * 0.5 * (states[1][1:] + states[1][:-1]))
    assert gap.max() < 1e-5


@pytest.mark.parametrize("early", [0, 1, 20])
def test_whichever_tick_takes_it_sends_the_same(early: int) -> None:
    motion, job = running()
    tick = moving_tick(0.5)
    present = joins_row(job, tick) - 40
    made = joined_job(joined(motion, job, begin_at(motion, tick), present), job, SETTINGS, None, present)
    taken = Schedule(job)
    sent = []
    for row in range(present, len(made.q)):
        if row == made.joins_row - early:
            taken.go_by(made)
        sent.append(taken.command(row))
    assert sent == [(made.q[row], made.qd[row]) for row in range(present, len(made.q))]


def test_every_row_still_to_be_sent_has_a_brake() -> None:
    motion, job = running()
    tick = moving_tick(0.5)
    present = joins_row(job, tick) - 25
    made = joined_job(joined(motion, job, begin_at(motion, tick), present), job, SETTINGS, None, present)
    rows = np.arange(len(made.q))
    assert (np.array(made.brake_row) >= rows).all()
    moving = np.abs(np.array(made.qd)).max(axis=1) > 1e-6
    assert (np.array(made.brake_ticks)[moving & (rows >= present)] > 0).all()
    assert made.brake_ticks[:present] == job.brake_ticks[:present]


@pytest.mark.parametrize(("field", "word"), [("start", "position"), ("start_qd", "velocity"), ("start_qdd", "accel")])
def test_a_plan_that_begins_beside_the_motion_is_refused(field: str, word: str) -> None:
    motion, job = running()
    new = begin_at(motion, moving_tick(0.5))
    off = replace(new, problem=replace(new.problem, **{field: getattr(new.problem, field) + 2e-6}))
    with pytest.raises(CannotJoin, match=f"off in {word}"):
        joined(motion, job, off, 10)


def test_a_tick_that_has_passed_is_refused() -> None:
    motion, job = running()
    tick = moving_tick(0.5)
    new = begin_at(motion, tick)
    last = joins_row(job, tick)
    assert joined(motion, job, new, last - 1).joins_s is not None
    with pytest.raises(CannotJoin, match="tick passed"):
        joined(motion, job, new, last + 1)


def test_of_two_ticks_in_the_same_state_the_one_asked_for_counts() -> None:
    home = running()[0].problem.start
    still = Passage("again", JointRelease(home, np.zeros(6)))
    motion = motion_of(to_and_fro(rest("a", 1.0), still, rest("b", -1.0)))
    job = prepare_job(motion.problem, motion.trajectory, None, "speedj", False, SETTINGS)
    dt = motion.trajectory.dt
    again = motion.trajectory.passed[1]
    asked = replace(motion_of(to_and_fro(rest("on", 1.0))), joins_s=again * dt)
    assert joined(motion, job, asked, 0).joins_s == pytest.approx(again * dt)
    assert joined(motion, job, replace(asked, joins_s=None), 0).joins_s == 0.0
    with pytest.raises(CannotJoin, match="off in position"):
        joined(motion, job, replace(asked, joins_s=(again + 200) * dt), 0)


def test_outputs_that_were_switched_stay_and_those_to_come_are_the_plans() -> None:
    motion, job = running()
    edge = round(motion.trajectory.passed[0] + 0.1 / motion.trajectory.dt)  # between the two lamps
    on = Passage("on", rest("", 0.5).state, (OutputSwitch("standard_digital", 3, True),))
    whole = joined(motion, job, begin_at(motion, edge, on), 10)
    made = joined_job(whole, job, SETTINGS, None, 10)
    assert [each.index for each in made.switches] == [1, 3]
    assert made.switches[0] == job.switches[0]


def test_an_output_that_was_to_be_switched_back_must_be_taken_care_of() -> None:
    pulse = tuple(OutputSwitch("standard_digital", 1, level, offset) for level, offset in ((True, 0.0), (False, 0.4)))
    motion = motion_of(to_and_fro(rest("a", 1.0, *pulse), rest("b", -1.0)))
    job = prepare_job(motion.problem, motion.trajectory, None, "speedj", False, SETTINGS)
    between = round(motion.trajectory.passed[0] + 0.2 / motion.trajectory.dt)
    with pytest.raises(CannotJoin, match="standard_digital 1 was switched"):
        joined(motion, job, begin_at(motion, between), 10)
    off = Passage("off", rest("", 0.5).state, (OutputSwitch("standard_digital", 1, False),))
    assert joined(motion, job, begin_at(motion, between, off), 10).joins_s is not None


def test_a_whole_that_switches_more_outputs_than_can_be_noted_is_refused() -> None:
    """Each of the plans may switch 160."""
    motion, _ = running()
    dt = motion.trajectory.dt
    memory = SharedMemory.create(5)
    most = len(memory.switched)
    memory.close()

    def flashes(name: str, side: float, count: int) -> Passage:
        edges = [OutputSwitch("standard_digital", 1, k % 2 == 0, -dt * (count - k)) for k in range(count)]
        return rest(name, side, *edges)

    first = motion_of(to_and_fro(flashes("a", 1.0, 160), rest("b", -1.0)))
    job = prepare_job(first.problem, first.trajectory, None, "speedj", False, SETTINGS)
    tick = first.trajectory.passed[0] + 100
    for count in (most - 160, most - 158):
        new = begin_at(first, tick, flashes("on", 1.0, count))
        whole = joined(first, job, new, 10)
        if count + 160 <= most:
            assert len(joined_job(whole, job, SETTINGS, None, 10).switches) == most
            continue
        with pytest.raises(CannotJoin, match=f"would switch {most + 2} outputs, and can {most}"):
            joined_job(whole, job, SETTINGS, None, 10)


def test_a_throw_replaces_a_throw_until_the_gripper_is_told_to_open() -> None:
    here = cell()
    throw = JointRelease(here.home + 0.5 * ASIDE, 0.6 * np.ones(6))
    motion = motion_of(ThrowProblem(here, here.home, throw, here.limits))
    job = prepare_job(motion.problem, motion.trajectory, None, "speedj", False, SETTINGS)
    tick = 60
    trajectory = motion.trajectory
    state = {"start": trajectory.q[tick], "start_qd": trajectory.qd[tick], "start_qdd": trajectory.qdd[tick]}
    new = motion_of(ThrowProblem(here, release=replace(throw, q=throw.q + 0.05), limits=here.limits, **state))
    new = replace(new, joins_s=None)
    made = joined_job(joined(motion, job, new, 5), job, SETTINGS, None, 5)
    opens_s = made.first_clock_s + made.output_row * made.dt
    released_s = tick * trajectory.dt + new.trajectory.release_time_s
    assert opens_s == pytest.approx(released_s - here.gripper.delay_s, abs=1e-9)
    with pytest.raises(CannotJoin, match="lets go of the object"):
        joined(motion, replace(job, output_row=joins_row(job, tick) - 1), new, 5)
    with pytest.raises(CannotJoin, match="throws nothing"):
        joined(motion, replace(job, output_row=-1), new, 5)


def test_a_packed_job_is_the_job() -> None:
    _, job = running()
    found = StreamJob.unpacked(memoryview(job.packed()))
    for name in ("q", "qd", "qdd", "reference_q", "reference_qd", "brake_row", "brake_ticks"):
        assert [*getattr(found, name)] == getattr(job, name)
    assert found.q[-1] == job.q[-1]
    with pytest.raises(IndexError):
        found.q[len(job.q)]
    lists = {name: getattr(job, name) for name in ("q", "qd", "qdd", "reference_q", "reference_qd")}
    assert replace(found, **lists, brake_row=job.brake_row, brake_ticks=job.brake_ticks) == job


def test_an_offer_does_not_overwrite_the_one_before() -> None:
    memory = SharedMemory.create(5)
    other = SharedMemory.attach(os.dup(memory.fd))
    first = other.offered()
    memory.offer(b"first", 0)
    assert bytes(first[:5]) == b"first"
    memory.offer(b"other", 1)
    assert bytes(other.offered()[:5]) == b"other"
    assert bytes(first[:5]) == b"first"
    assert other.fields[shm.OFFERED] == 2
    assert other.capacity == 5
    first.release()
    memory.close()


def started_certifier(certifier: Certifier | None = None) -> tuple[Certifier, BaseProcess]:
    others = active_children()
    certifier = certifier or Certifier()
    certifier.start()
    (child,) = (each for each in active_children() if each not in others)
    return certifier, child


def await_killed(child: BaseProcess) -> None:
    deadline = time.monotonic() + ENDED_S
    while child.exitcode is None and time.monotonic() < deadline:  # the pool's thread may be reaping it meanwhile
        time.sleep(0.01)
    assert child.exitcode == -signal.SIGKILL


def test_a_certifier_ends_without_being_loaded() -> None:
    """The daemon ends when it is told to, not when its helper has read its modules."""
    certifier, child = started_certifier()
    certifier.stop()
    await_killed(child)


def test_a_certifier_that_does_not_answer_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    certifier, child = started_certifier()
    os.kill(child.pid, signal.SIGSTOP)
    monkeypatch.setattr(replacement, "ANSWER_S", 0.05)
    with pytest.raises(CannotJoin, match="has not answered within"):
        certifier.ask(None)
    await_killed(child)
    with pytest.raises(CannotJoin, match="no process that certifies"):
        certifier.ask(None)


def test_a_certifier_that_was_killed_is_started_anew() -> None:
    certifier, child = started_certifier()
    pool = certifier._pool
    child.kill()
    until(lambda: pool._broken)
    with pytest.raises(CannotJoin, match="it is started with the next execution"):
        certifier.ask(None)
    again, child = started_certifier(certifier)
    assert again is certifier
    certifier.stop()
    await_killed(child)


def test_the_motion_before_a_second_replacement_is_the_whole_of_the_first() -> None:
    motion, job = running()
    tick = moving_tick(0.3)
    first = joined(motion, job, begin_at(motion, tick), 5)
    onward = joined_job(first, job, SETTINGS, None, 5)
    later = tick + 20
    second = joined(first, onward, begin_at(first, later), 10)
    made = joined_job(second, onward, SETTINGS, None, 10)
    assert isinstance(second.trajectory, Trajectory)
    assert made.q[: made.joins_row] == onward.q[: made.joins_row]
    assert second.joins_s == pytest.approx(later * motion.trajectory.dt)


def test_a_plan_that_waits_for_a_target_that_moves_joins_no_motion() -> None:
    """It would be thrown when the running motion happens to be there, at a target that is elsewhere."""
    motion, job = running()
    asked = motion_of(to_and_fro(rest("on", 1.0)))
    assert joined(motion, job, asked, 0).joins_s == 0.0
    waits = replace(asked, problem=replace(asked.problem, starts_at_s=1000.0))
    with pytest.raises(CannotJoin, match=r"starts at 1000\.000 s of the controller's clock"):
        joined(motion, job, waits, 0)
