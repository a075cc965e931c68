"""Driving a batch or a map: plans in a pool what has no answer yet, and stores each answer once.

A driver may be killed at any time: whoever drives next begins with what is not stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from typing import Protocol

from jobs.planning import PlanningJob
from jobs.pool import BATCH_NICENESS, PLANNING, JobResult, Work, open_pool, warm_up_job
from jobs.writer import Put, ResultWriter, Save
from planner.cell import CellSource

WARM_UP_FROM = 100  # jobs left from which on each worker warms up first: a second that pays later

MustStop = Callable[[], bool]


class PlanAll(Protocol):
    """Plans jobs in any order, such as `PlannerPool.plan_all`."""

    def __call__(self, jobs: Iterable[PlanningJob], must_stop: MustStop) -> Iterator[JobResult]:
        """Yields the results until there are no more, or `must_stop`."""
        ...


class Task(Protocol):
    """What is driven: a batch, or a map.

    Attributes:
        left: number of answers that are missing, or an upper bound of it.
        source: content of the files of a cell that it plans for; warms the workers up.
        save: stores answers with their plans.
        is_cancelled: whether somebody had asked for its end before it was driven.
    """

    left: int
    source: CellSource
    save: Save
    is_cancelled: bool

    def steps(self, put: Put) -> Iterator[Iterator[PlanningJob]]:
        """Yields the jobs of each step, once the answers to those before are stored; `put` takes what is known."""
        ...

    def answer(self, result: JobResult, put: Put) -> None:
        """Puts the answers that the result of a job brings in line to be stored."""
        ...

    def end(self, is_cancelled: bool, is_complete: bool) -> None:
        """Records that it is not driven any more: cancelled, complete, or stopped, so that somebody goes on."""
        ...


def run(
    task: Task,
    workers: int | None = None,
    ray_address: str | None = None,
    must_stop: MustStop = lambda: False,
    work: Work = PLANNING,
) -> None:
    """Drives a task to its end with planner processes of its own.

    Args:
        task: what to plan.
        workers: number of planner processes; None: one a core.
        ray_address: address of a Ray cluster; None: processes of this machine.
        must_stop: asked every second at least; true ends the planning, and the task can be taken up again.
        work: what a planner process does.

    Raises:
        BatchLost: another driver has taken it over.
        PoolBroken: no planner process can be started.
    """
    if task.left == 0 or task.is_cancelled:
        drive(task, _plan_nothing, must_stop)
        return
    warm_up = warm_up_job(task.source) if task.left >= WARM_UP_FROM else None
    own_work = replace(work, warm_up=warm_up, niceness=BATCH_NICENESS)
    with open_pool(workers, ray_address, own_work, most=task.left) as pool:
        drive(task, pool.plan_all, must_stop)


def drive(task: Task, plan_all: PlanAll, must_stop: MustStop = lambda: False) -> None:
    """Drives a task to its end.

    Args:
        task: what to plan.
        plan_all: plans jobs in any order.
        must_stop: true ends the planning, and the task can be taken up again.

    Raises:
        BatchLost: another driver has taken it over.
    """
    writer = ResultWriter(task.save, task.is_cancelled)

    def must_end() -> bool:
        return must_stop() or writer.must_stop

    is_complete = False
    try:
        with writer:
            is_complete = _plan_steps(task, plan_all, must_end, writer)
    finally:
        if writer.loss is None:
            task.end(writer.is_cancelled, is_complete)
    if writer.loss is not None:
        raise writer.loss


def _plan_nothing(jobs: Iterable[PlanningJob], must_stop: MustStop) -> Iterator[JobResult]:
    yield from ()


def _plan_steps(task: Task, plan_all: PlanAll, must_end: MustStop, writer: ResultWriter) -> bool:
    """Plans step by step; returns whether all of them were planned."""
    for jobs in task.steps(writer.put):
        if must_end():
            return False
        with closing(plan_all(jobs, must_end)) as results:  # type: ignore[type-var]
            for result in results:
                task.answer(result, writer.put)
        writer.flush()
        if must_end():
            return False
    return True
