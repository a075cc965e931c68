"""Driving a batch or a map: plans in a pool what has no answer yet, and stores each answer once.

A driver may be killed at any time: the next one resumes with what is not stored.
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

MustStop = Callable[[], bool]


class PlanAll(Protocol):
    """Plans jobs in any order, such as `PlannerPool.plan_all`."""

    def __call__(self, jobs: Iterable[PlanningJob], must_stop: MustStop) -> Iterator[JobResult]:
        """Yields the results until there are no more, or `must_stop`."""
        ...


class Drivable(Protocol):
    """What is driven: a batch, or a map.

    Attributes:
        left: number of answers that are missing, or an upper bound of it.
        source: content of the files of a cell that it plans for; warms the workers up.
        save: stores answers with their plans.
        is_cancelled: whether it was cancelled before this driver took it.
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
        """Records that this driver has ended: cancelled, complete, or stopped, so that another one can resume."""
        ...


def run(
    driven: Drivable,
    workers: int | None = None,
    ray_address: str | None = None,
    must_stop: MustStop = lambda: False,
    work: Work = PLANNING,
) -> None:
    """Drives a batch or map to its end with planner processes of its own.

    Args:
        driven: what to plan.
        workers: number of planner processes; None: one a core.
        ray_address: address of a Ray cluster; None: processes of this machine.
        must_stop: asked every second at least; true ends the planning, and the next driver resumes.
        work: what a planner process does.

    Raises:
        BatchLost: another driver has taken it over.
        PoolBroken: no planner process can be started.
    """
    if driven.left == 0 or driven.is_cancelled:
        drive(driven, _plan_nothing, must_stop)
        return
    own_work = replace(work, warm_up=warm_up_job(driven.source), niceness=BATCH_NICENESS)  # no answer counts loading
    with open_pool(workers, ray_address, own_work, most=driven.left) as pool:
        drive(driven, pool.plan_all, must_stop)


def drive(driven: Drivable, plan_all: PlanAll, must_stop: MustStop = lambda: False) -> None:
    """Drives a batch or map to its end.

    Args:
        driven: what to plan.
        plan_all: plans jobs in any order.
        must_stop: true ends the planning, and the next driver resumes.

    Raises:
        BatchLost: another driver has taken it over.
    """
    writer = ResultWriter(driven.save, driven.is_cancelled)

    def must_end() -> bool:
        return must_stop() or writer.must_stop

    is_complete = False
    try:
        with writer:
            is_complete = _plan_steps(driven, plan_all, must_end, writer)
    finally:
        if writer.loss is None:
            driven.end(writer.is_cancelled, is_complete)
    if writer.loss is not None:
        raise writer.loss


def _plan_nothing(jobs: Iterable[PlanningJob], must_stop: MustStop) -> Iterator[JobResult]:
    yield from ()


def _plan_steps(driven: Drivable, plan_all: PlanAll, must_end: MustStop, writer: ResultWriter) -> bool:
    """Plans step by step; returns whether all of them were planned."""
    for jobs in driven.steps(writer.put):
        if must_end():
            return False
        with closing(plan_all(jobs, must_end)) as results:  # type: ignore[type-var]
            for result in results:
                driven.answer(result, writer.put)
        writer.flush()
        if must_end():
            return False
    return True
