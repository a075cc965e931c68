"""Replacing a running motion: a plan that begins on it becomes one motion with what of it was made before.

The running motion up to the tick at which the plan begins, and the plan from there on, are sampled as one, with a brake
from each row that is still to be sent. Up to that tick the rows are the running ones, so that the streaming process may
go by the new job at any tick before (docs/decisions/0034-replacing-a-running-motion.md). All of this is computed in a
process of its own: in the daemon it would hold the interpreter's lock, for which the pulse waits.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess

import numpy as np
import orjson
from numpy.typing import NDArray

from executor import realtime
from executor.preflight import ExecutionRefused, prove_plan, verify_plan
from executor.preparation import RunningRows, landing_of, prepare_job
from executor.settings import ExecutorSettings
from executor.shared_memory import OFFER_BYTES, SWITCHES_MAX
from executor.stream_job import NOT_IN_MOTION, ExpectedLanding, StreamJob
from planner.cell import Cell
from planner.certificate import START_TOLERANCE
from planner.errors import InvalidProblem
from planner.passages import OutputEdge, Passage, output_edges
from planner.problem import ThrowProblem
from planner.releases import JointRelease
from planner.trajectory import Trajectory
from store import TICK_PASSED, ProfileRow

Vector = NDArray[np.float64]

SAME = 1e-9  # [rad, rad/s] by which rows of one motion may differ: rounding of plan times
ROUNDING = 1e-6  # [ticks] of a plan time in floating point
CERTIFIER_ENDED = "the certifying process ended; it is started with the next execution"
ANSWER_S = 3.0  # [s] for a certificate: it takes some tenths of a second, a second where it has to be proven
UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2"}


class CannotJoin(Exception):
    """The running motion goes on untouched; the text says why."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What an execution makes.

    Attributes:
        problem: of its plan.
        trajectory: the motion, from the execution's first tick on.
        aim_shift: by how much the aim lies off the target (3,) [m].
        joins_s: when the plan begins, on the execution's clock [s]: 0 for its first. Of a plan that has not joined yet
            when it asks to begin; None: it does not say.
    """

    problem: ThrowProblem
    trajectory: Trajectory
    aim_shift: Vector
    joins_s: float | None = 0.0

    def fresh(self) -> Motion:
        """Returns it without what was computed of it, as another process takes it."""
        return replace(self, problem=replace(self.problem), trajectory=replace(self.trajectory))


@dataclass(frozen=True, eq=False)
class Question:
    """What the certifying process is asked.

    Attributes:
        execution_id: of the run.
        document: the plan that is to replace the running one.
        cell: the executor's own.
        profile: that the cell uses.
        running: what the run makes.
        job: its rows, packed.
        present: row that has been sent.
        settings: of the executor.
        waits: whether the run still waits for the instant at which its plan starts.
    """

    execution_id: str
    document: bytes
    cell: Cell
    profile: ProfileRow | None
    running: Motion
    job: bytes
    present: int
    settings: ExecutorSettings
    waits: bool = False


@dataclass(frozen=True, eq=False)
class Replacement:
    """A certified plan, joined to the running motion.

    Attributes:
        motion: the whole.
        job: its rows, packed.
    """

    motion: Motion
    job: bytes


def answer(question: Question) -> Replacement | str:
    """Returns what replaces the running motion, or why nothing does; in some tenths of a second, before it is late."""
    with realtime.urgent():
        return _answer(question)


def _answer(question: Question) -> Replacement | str:
    job = StreamJob.unpacked(memoryview(question.job))
    try:
        asked_s = _asked_s(question)
        plan = Motion(*verify_plan(question.document, question.cell, question.profile), asked_s)
        if question.settings.must_be_proven:
            prove_plan(question.document, question.cell, question.profile)
        motion = (
            instead(question.running, plan) if question.waits else joined(question.running, job, plan, question.present)
        )
        landing = landing_of(question.document, motion.problem, motion.trajectory, question.profile)
        if question.waits:
            made = waiting_job(motion, job, question.settings, landing)
        else:
            made = joined_job(motion, job, question.settings, landing, question.present)
    except (CannotJoin, ExecutionRefused, InvalidProblem) as error:
        return str(error)
    packed = made.packed()
    if len(packed) > OFFER_BYTES:
        return f"the whole motion would take {made.dt * len(made.q):.0f} s: too long for one execution"
    return Replacement(motion.fresh(), packed)


def _asked_s(question: Question) -> float | None:
    """Returns when a plan asks to begin on the run's clock [s]; None where it does not say.

    Raises:
        CannotJoin: it asks to begin on another execution.
    """
    start = orjson.loads(question.document)["request"].get("start", {})
    if start.get("execution", question.execution_id) != question.execution_id:
        raise CannotJoin(f"the plan begins on another execution, {start['execution']}")
    return start.get("at_s")


def loaded() -> None:
    """Does nothing but load this module."""


class Certifier:
    """The process that answers questions, started beforehand: it takes a second to load."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # the thread that asks outlives its run where an answer is late
        self._pool: ProcessPoolExecutor | None = None
        self._children: list[BaseProcess] = []

    def start(self) -> None:
        """Starts it where it does not run, from a thread that lives as long as it is to."""
        with self._lock:
            if self._pool is not None:
                return
            context = get_context("spawn")
            self._pool = ProcessPoolExecutor(1, context, realtime.terminate_with_parent, (os.getpid(),))
            others = active_children()
            self._pool.submit(loaded)  # which starts its process
            self._children = [child for child in active_children() if child not in others]

    def ask(self, question: Question) -> Replacement:
        """Returns what replaces the running motion.

        Raises:
            CannotJoin: nothing does.
        """
        pool = self._pool
        if pool is None:
            raise CannotJoin("this executor has no process that certifies")
        try:
            asked = pool.submit(answer, question)
        except RuntimeError:  # it was ended meanwhile, by `stop` or from outside
            self._end(pool)
            raise CannotJoin(CERTIFIER_ENDED) from None
        try:
            found = asked.result(ANSWER_S)
        except (BrokenProcessPool, CancelledError):
            self._end(pool)
            raise CannotJoin(CERTIFIER_ENDED) from None
        except TimeoutError:
            self._end(pool)
            late = f"the certifying process has not answered within {ANSWER_S:.0f} s"
            raise CannotJoin(f"{late}; it is started anew with the next execution") from None
        if isinstance(found, str):
            raise CannotJoin(found)
        return found

    def stop(self) -> None:
        """Ends it at once: this process would wait at its end for one that is still loading, certifying, or frozen."""
        if self._pool is not None:
            self._end(self._pool)

    def _end(self, pool: ProcessPoolExecutor) -> None:
        """Ends the process of a pool, unless another one has taken its place."""
        with self._lock:
            if pool is not self._pool:
                return
            children = self._children
            self._pool = None
            self._children = []
        pool.shutdown(wait=False, cancel_futures=True)
        for child in children:
            child.kill()


def joined(running: Motion, job: StreamJob, new: Motion, present: int) -> Motion:
    """Returns the motion that follows the running one to the tick at which a plan begins, and the plan from there.

    Args:
        running: what the execution makes.
        job: its rows.
        new: the plan, certified.
        present: row that has been sent.

    Raises:
        CannotJoin: the plan does not begin on what is left of the running motion, or what that has begun must end.
    """
    if (starts_at_s := new.problem.starts_at_s) is not None:
        raise CannotJoin(f"the plan starts at {starts_at_s:.3f} s of the controller's clock, and joins no motion")
    _check_grippers(running, new)
    tick = _join_tick(running.trajectory, new, first_tick(job, present))
    begins = joins_row(job, tick)
    _check_gripper(job, new.problem, begins)
    edges = output_edges(running.problem.cell, running.problem.passages, running.trajectory)
    kept = [edge for edge, switch in zip(edges, job.switches, strict=True) if switch.row < begins]
    _check_outputs(kept, edges[len(kept) :], new)
    indices = [min(running.trajectory.passed[edge.passage], tick) for edge in kept]
    passages = _passages(running.trajectory, kept, indices, new.problem)
    ticks = [*indices, *(tick + k for k in new.trajectory.passed)] if passages else []
    arrays = [
        np.concatenate([getattr(running.trajectory, name)[:tick], getattr(new.trajectory, name)])
        for name in ("q", "qd", "qdd")
    ]
    rate_hz = running.trajectory.sample_rate_hz
    motion = Trajectory(
        rate_hz, *arrays, release_index=tick + new.trajectory.release_index, passage_indices=tuple(ticks)
    )
    whole = new.problem.at_rest_from(running.trajectory.q[0])
    whole = replace(whole, limits=whole.cell.limits, passages=passages, backend="auto")
    return Motion(whole, motion, new.aim_shift, tick / rate_hz)


def instead(waiting: Motion, new: Motion) -> Motion:
    """Returns the motion that an arm makes in place of one that it still waits to begin.

    Args:
        waiting: what it waits to begin.
        new: the plan, certified.

    Raises:
        CannotJoin: the plan does not begin where the arm waits, does not start at an instant, or holds the object
            otherwise.
    """
    if new.problem.starts_at_s is None or not new.problem.starts_at_rest:
        raise CannotJoin(
            "the execution waits at its start: a plan that starts at rest at an instant can replace its own"
        )
    off = np.abs(new.trajectory.q[0] - waiting.trajectory.q[0])
    if not off.max() <= START_TOLERANCE:
        joint = int(off.argmax())
        raise CannotJoin(f"the plan begins {off[joint]:.3g} rad from where the arm waits, in joint {joint + 1}")
    _check_grippers(waiting, new)
    if new.problem.throws != waiting.problem.throws:
        raise CannotJoin("one of the two plans throws nothing: the gripper was readied for the other")
    return replace(new, joins_s=0.0)


def _check_grippers(present: Motion, new: Motion) -> None:
    """Refuses a replacement in which one of several grippers lets go.

    Raises:
        CannotJoin: one does in either plan.
    """
    if present.problem.names_gripper or new.problem.names_gripper:
        raise CannotJoin("one of the cell's [grippers] lets go in one of the two plans: that cannot be replaced yet")


def waiting_job(
    motion: Motion, job: StreamJob, settings: ExecutorSettings, landing: ExpectedLanding | None
) -> StreamJob:
    """Returns the job of a motion that `instead` returned; a stream that has begun never takes it."""
    how = (job.mode, job.dry_run, settings, landing)
    return replace(prepare_job(motion.problem, motion.trajectory, None, *how), joins_row=NOT_IN_MOTION)


def joined_job(
    motion: Motion, job: StreamJob, settings: ExecutorSettings, landing: ExpectedLanding | None, present: int
) -> StreamJob:
    """Returns the job of a motion that `joined` made.

    Raises:
        CannotJoin: its rows are not those of the running job up to where it begins.
    """
    how = (job.mode, job.dry_run, settings, landing, RunningRows(job, max(present, 0)))
    made = prepare_job(motion.problem, motion.trajectory, None, *how)
    begins = joins_row(job, round((motion.joins_s or 0.0) / job.dt))
    for name in ("q", "qd", "reference_q", "reference_qd"):
        before, after = (np.array([*getattr(each, name)][:begins]) for each in (job, made))
        if not np.abs(before - after).max(initial=0.0) <= SAME:
            raise CannotJoin(f"bug in Fling: the {name} of rows before the join differ")
    sent = sum(each.row < begins for each in job.switches)
    early = [each for each in made.switches[sent:] if each.row < begins]
    if early:
        raise CannotJoin(f"{early[0].output} {early[0].index} would have to be switched before the plan begins")
    if 0 <= made.output_row < begins:
        raise CannotJoin("the gripper would have to be told to open before the plan begins")
    if len(made.switches) > SWITCHES_MAX:
        raise CannotJoin(f"the whole motion would switch {len(made.switches)} outputs, and can {SWITCHES_MAX}")
    return replace(made, joins_row=begins)


def joins_row(job: StreamJob, tick: int) -> int:
    """Returns the first row after a tick of the motion: the first that is another one's."""
    return math.floor(tick - job.first_clock_s / job.dt + ROUNDING) + 1


def first_tick(job: StreamJob, present: int) -> int:
    """Returns the first tick of the motion at which another one can still begin, now that a row has been sent."""
    return max(math.ceil(job.first_clock_s / job.dt + present - ROUNDING), 0)


def _join_tick(running: Trajectory, new: Motion, first: int) -> int:
    """Returns the tick from `first` on at which the running motion is in a plan's start; the one that it asks for.

    Raises:
        CannotJoin: there is none; says what does not fit where they are nearest, or that the tick has passed.
    """
    states = (running.q, running.qd, running.qdd)
    start = new.problem.start_state
    off = np.stack([np.abs(x - own).max(axis=1) for x, own in zip(states, start, strict=True)])
    if new.joins_s is not None:
        off[:, np.arange(off.shape[1]) != round(new.joins_s * running.sample_rate_hz)] = np.inf
    meets = np.flatnonzero((off <= START_TOLERANCE).all(axis=0))
    if len(meets) and meets[-1] >= first:
        return int(meets[meets >= first][0])
    if len(meets):
        passed_s = (first - int(meets[-1])) * running.dt
        at_s = int(meets[-1]) * running.dt
        late = f"the plan begins at {at_s:.3f} s of the motion, which is {passed_s:.3f} s ago"
        raise CannotJoin(f"{TICK_PASSED}: {late}")
    nearest = int(off[0].argmin())
    wrong = [
        f"{name} by {size:.3g} {unit}"
        for (name, unit), size in zip(UNITS.items(), off[:, nearest].tolist(), strict=True)
        if size > START_TOLERANCE
    ]
    at_s = nearest * running.dt
    raise CannotJoin(f"the plan does not begin on the motion: at {at_s:.3f} s it is off in {', '.join(wrong)}")


def _check_gripper(job: StreamJob, problem: ThrowProblem, begins: int) -> None:
    """Raises `CannotJoin` where the object has left by then, or nobody has looked whether it is held."""
    if 0 <= job.output_row < begins:
        raise CannotJoin("the running plan lets go of the object before the plan begins")
    if problem.throws and job.output_row < 0:
        raise CannotJoin("the running plan throws nothing, so its gripper was not closed and is not watched")


def _check_outputs(kept: Sequence[OutputEdge], dropped: Sequence[OutputEdge], new: Motion) -> None:
    """Raises `CannotJoin` where an output that was switched would not get what the running plan still has for it."""
    taken = {_line(edge) for edge in output_edges(new.problem.cell, new.problem.passages, new.trajectory)}
    switched = {_line(edge) for edge in kept}
    for edge in dropped:
        if _line(edge) in switched - taken:
            output, index = _line(edge)
            at_s = edge.edge_time_s
            raise CannotJoin(f"{output} {index} was switched, and at {at_s:.3f} s again: the plan must take care of it")


def _line(edge: OutputEdge) -> tuple[str, int]:
    return edge.switch.output, edge.switch.index


def _passages(
    running: Trajectory, kept: Sequence[OutputEdge], indices: Sequence[int], problem: ThrowProblem
) -> tuple[Passage, ...]:
    """Returns the passages of the whole: one for each edge that was made before, and the plan's own.

    None where no output is switched and the plan has none.
    """
    if not kept:
        return problem.passages
    before = tuple(
        Passage(
            f"before {number + 1}",
            JointRelease(running.q[k], running.qd[k]),
            (replace(edge.switch, offset_s=edge.edge_time_s - k * running.dt),),
        )
        for number, (edge, k) in enumerate(zip(kept, indices, strict=True))
    )
    own = problem.passages or (Passage("release", problem.release, releases=problem.throws),)
    return before + own
