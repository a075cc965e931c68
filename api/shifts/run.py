"""One job, carried out: the record says what comes next, which is planned while the arm moves, and executed.

A motion is written with its execution in one transaction. So a driver that takes a job over finds in the record all
that was ever asked for: it waits for what runs, and goes on from there.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from starlette.concurrency import run_in_threadpool

from api.dependencies import Service
from api.http import ProblemDetails
from api.routes import check_executable
from api.shifts.planned import MotionPlanner, PlannedMotion
from jobs.cycles import MOVED, NOT_PLANNED, THROWN, JobOrder, JobProgress, NextMotion, cycle_end, progress_of
from store import (
    AuditLine,
    CellBusy,
    ExecutionRow,
    JobCycleRow,
    JobLost,
    JobRow,
    StoreError,
    StoreUnavailable,
)

BEAT_S = 1.0  # [s] between two heartbeats
WATCH_S = 0.05  # [s] between two looks at a running execution
WAIT_S = 0.5  # [s] between two looks at what is waited for: the end of a pause, a free cell
READY_S = 10.0  # [s] that a robot may be not ready before the job stops: a busy machine delays heartbeats
UNUSABLE_MAX = 3  # plans in a row that could not be executed any more as soon as they were there
FREE_IT = "empty and open it, then resume"
MOVING = ("streaming", "braking")  # states of an execution that moves
LOST = "executor_lost"  # outcome that a later executor assumes, until the lost one's own record is found

log = logging.getLogger("fling")


class JobRun:
    """One job.

    Args:
        service: whose planner processes it uses.
        row: the job, claimed by this driver.
        driver_id: name of the driver.
    """

    def __init__(self, service: Service, row: JobRow, driver_id: str) -> None:
        self._service = service
        self._store = service.store
        self._job = row
        self._driver_id = driver_id
        self._order = JobOrder.read(row.ordered, row.cell)
        self._planner = MotionPlanner(service, self._order, row.request_id or "")
        self._state = "paused" if row.pause_requested_at else "running"
        self._unready_since: float | None = None
        self._unusable = 0

    async def run(self) -> None:
        """Carries the job out, to its end or until another driver has it; if the task is cancelled, gives it up."""
        work = asyncio.create_task(self._work())
        heart = asyncio.create_task(self._beat())
        try:
            await asyncio.wait((work, heart), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (work, heart):
                task.cancel()
            ended = await asyncio.gather(work, heart, return_exceptions=True)
            self._planner.close()
            with suppress(StoreError):  # it is finished, or another one's
                await run_in_threadpool(self._store.release_job, self._job.id, self._driver_id)
        for error in ended:
            if isinstance(error, Exception) and not isinstance(error, JobLost):
                raise error

    async def _beat(self) -> None:
        while True:
            with suppress(StoreUnavailable):  # the store has logged it
                self._job = await run_in_threadpool(self._store.beat_job, self._job.id, self._driver_id, self._state)
            await asyncio.sleep(BEAT_S)

    async def _work(self) -> None:
        while True:
            try:
                if await self._step():
                    return
            except StoreUnavailable:
                await asyncio.sleep(WAIT_S)

    async def _step(self) -> bool:
        """Does what comes next; returns whether the job is finished."""
        progress = await self._progress()
        running = next((row for row in progress.rows if row.result is None), None)
        if running is not None:
            await self._follow(running, progress)
            return False
        if await run_in_threadpool(self._learn_late, progress.rows):
            return False
        self._job = await run_in_threadpool(self._store.beat_job, self._job.id, self._driver_id, self._state)
        if self._job.cancel_requested_at is not None:
            return await self._finish("cancelled")
        if (reason := progress.stop_reason(self._job.resumed_at or 0.0)) is not None:
            return await self._finish("stopped", reason)
        self._state = "running" if self._job.pause_requested_at is None else "paused"
        if self._state == "paused":
            self._unready_since = None
            await asyncio.sleep(WAIT_S)
            return False
        return await self._go_on(progress)

    async def _go_on(self, progress: JobProgress) -> bool:
        """Plans and asks for the next motion; returns whether the job is finished."""
        if progress.next_motion(None) is None:
            return await self._finish("completed")
        where = await self._planner.where(progress)
        if where is None:
            return await self._not_ready(f"no executor reports where the robot of cell {self._job.cell!r} stands")
        motion = progress.next_motion(where.pick)
        assert motion is not None  # something waits
        number = len(progress.rows)
        planned = await self._planner.planned(motion, where.positions)
        if not isinstance(planned, PlannedMotion):
            await run_in_threadpool(self._store.add_job_cycle, self._driver_id, self._refused(number, motion, planned))
            return False
        if not where.is_at(await self._planner.where(progress)):  # it was moved meanwhile: the plan begins elsewhere
            self._planner.forget()
            return False
        if motion.kind == "approach" and (reason := await self._not_free(progress)) is not None:
            return await self._not_ready(reason)
        return await self._ask(planned, number)

    async def _ask(self, planned: PlannedMotion, number: int) -> bool:
        """Asks for a planned motion; returns whether the job is finished."""
        try:
            await run_in_threadpool(check_executable, self._service, planned.plan, planned.plan.id)
            await run_in_threadpool(
                self._store.ask_job_cycle,
                self._driver_id,
                planned.cycle(self._job.id, number),
                self._job.cell,
                self._job.created_by,
                self._audit(),
            )
        except CellBusy:  # somebody else's execution: when it has ended, the arm may be elsewhere
            await asyncio.sleep(WAIT_S)
        except ProblemDetails as problem:
            return await self._not_executable(problem)
        else:  # asked for, or the job was asked to pause or to end meanwhile
            self._unready_since = None
            self._unusable = 0
        return False

    async def _follow(self, cycle: JobCycleRow, progress: JobProgress) -> None:
        """Waits for the end of a motion, plans the one after it meanwhile, and notes what became of it."""
        result = MOVED if cycle.kind == "approach" else THROWN
        rows = [replace(row, result=result) if row is cycle else row for row in progress.rows]
        await self._planner.plan_ahead(replace(progress, rows=rows))
        assert cycle.execution_id is not None  # it was asked for
        while True:
            execution = await run_in_threadpool(self._store.execution, cycle.execution_id)
            assert execution is not None  # retention keeps those of jobs
            if execution.state == "finished":
                break
            await asyncio.sleep(WATCH_S)
        await run_in_threadpool(self._note_end, cycle, execution)

    def _note_end(self, cycle: JobCycleRow, execution: ExecutionRow) -> None:
        """Notes what a finished execution was for the job."""
        moved = any(state in MOVING for state in self._store.states_of(execution.id))
        end = cycle_end(cycle, execution, moved)
        said = {"outcome": execution.outcome, "reason": execution.reason, "ended_at": time.time()}
        ended = replace(cycle, result=end.result, object_at=end.object_at, **said)
        self._store.end_job_cycle(self._driver_id, ended)

    def _learn_late(self, rows: Sequence[JobCycleRow]) -> bool:
        """Notes what executors that were lost told once they were back; returns whether there was something new."""
        for cycle in rows:
            if cycle.outcome == LOST and cycle.execution_id is not None:
                execution = self._store.execution(cycle.execution_id)
                if execution is not None and execution.outcome != LOST:
                    self._note_end(cycle, execution)
                    return True
        return False

    async def _progress(self) -> JobProgress:
        rows = await run_in_threadpool(self._store.job_cycles, self._job.id)
        landings = await run_in_threadpool(self._store.landings_of_job, self._job.id)
        return progress_of(self._order, rows, landings)

    def _refused(self, number: int, motion: NextMotion, reason: str) -> JobCycleRow:
        """Returns the record of a motion that was not found: its object stays where it is."""
        return JobCycleRow(
            job_id=self._job.id,
            number=number,
            kind=motion.kind,
            pick=motion.pick,
            next_pick=motion.next_pick,
            attempt=motion.attempt,
            result=NOT_PLANNED,
            object_at="at its pick",
            reason=reason,
            ended_at=time.time(),
        )

    async def _not_free(self, progress: JobProgress) -> str | None:
        """Returns why the gripper is not free to go down on an object; None where it is, or nobody sees it.

        A simulated gripper starts closed, and nobody can open it by hand: before the first throw that does not count.
        """
        status = await run_in_threadpool(self._store.cell_status, self._job.cell)
        if status is None:
            return None
        if status.robot.get("gripper_holds"):
            return f"the gripper holds an object: {FREE_IT}"
        has_run = any(row.kind == "throw" and row.execution_id is not None for row in progress.rows)
        is_closed = status.robot.get("gripper_open") is False and (has_run or status.link_kind != "sim")
        return f"the gripper is closed: {FREE_IT}" if is_closed else None

    async def _not_ready(self, reason: str) -> bool:
        """Waits a little for a robot that is not ready; stops the job once it was not for `READY_S`."""
        now = time.monotonic()
        self._unready_since = self._unready_since or now
        if now - self._unready_since > READY_S:
            return await self._finish("stopped", reason)
        await asyncio.sleep(WAIT_S)
        return False

    async def _not_executable(self, problem: ProblemDetails) -> bool:
        """Goes on about a plan that may not be executed now; returns whether the job is finished."""
        reason = problem.detail or problem.name
        if problem.name == "robot-not-ready":
            return await self._not_ready(reason)
        self._planner.forget()  # cell file or profile have changed since: it is planned again
        self._unusable += 1
        if problem.name != "plan-not-executable" or self._unusable == UNUSABLE_MAX:
            return await self._finish("stopped", reason)
        return False

    async def _finish(self, outcome: str, reason: str | None = None) -> bool:
        await run_in_threadpool(self._store.finish_job, self._job.id, self._driver_id, outcome, reason)
        log.info("job %s: %s%s", self._job.id, outcome, f": {reason}" if reason else "")
        return True

    def _audit(self) -> AuditLine:
        return AuditLine(self._job.created_by, "execute", f"job {self._job.id}", self._job.request_id)
