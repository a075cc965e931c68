"""Planning for a job: where the arm stands, the motion from there, and the next one while the arm moves."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import orjson
from starlette.concurrency import run_in_threadpool

from api.dependencies import Service
from api.http import ProblemDetails
from api.planning import PlanningEnded, PlanningQueueFull
from api.routes import PlanOrder, current_positions, stored_plan
from jobs.cycles import NOT_PLANNED, STAYED, WENT, JobOrder, JobProgress, NextMotion, motion_request
from jobs.pool import PoolBroken
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.request import problem_from_request, read_request
from store import JobCycleRow, PlanRow, StoreError

THERE_RAD = 0.01  # [rad] an arm this near stands where its last motion ended; as executor.streaming.approach START_RAD
SETTLED_S = 3.0  # [s] until a heartbeat tells where the arm came to rest
LOOK_S = 0.05  # [s] between two looks
AGAIN_S = 1.0  # [s] until planner processes are asked again that could not answer
REFUSALS = (Infeasible, SolverFailed, InvalidProblem)


@dataclass(frozen=True)
class ArmPlace:
    """Where the arm stands.

    Attributes:
        pick: at which; None: elsewhere.
        positions: of the joints (6,) [rad].
    """

    pick: int | None
    positions: Sequence[float]

    def is_at(self, other: ArmPlace | None) -> bool:
        """Returns whether this is another place as well, as far as the arm's control tells them apart."""
        if other is None or self.pick != other.pick:
            return False
        return float(np.abs(np.subtract(self.positions, other.positions)).max()) <= THERE_RAD


@dataclass(frozen=True)
class PlannedMotion:
    """A motion of a job with its plan.

    Attributes:
        motion: may end at home where no motion to the next pick was found.
        plan: stored.
        target: number of the target; None of an approach.
        target_m: its place (3,) in the world [m].
        hit_radius_m: what counts as a hit [m].
    """

    motion: NextMotion
    plan: PlanRow
    target: int | None = None
    target_m: Sequence[float] | None = None
    hit_radius_m: float | None = None

    def cycle(self, job_id: str, number: int) -> JobCycleRow:
        """Returns its row."""
        motion = self.motion
        return JobCycleRow(
            job_id=job_id,
            number=number,
            kind=motion.kind,
            pick=motion.pick,
            next_pick=motion.next_pick,
            turn=motion.turn,
            target=self.target,
            attempt=motion.attempt,
            plan_id=self.plan.id,
            target_m=self.target_m,
            hit_radius_m=self.hit_radius_m,
        )


class MotionPlanner:
    """Plans the motions of one job.

    Args:
        service: whose planner processes plan.
        order: the job.
        request_id: of the HTTP request that ordered it.
    """

    def __init__(self, service: Service, order: JobOrder, request_id: str) -> None:
        self._service = service
        self._order = order
        self._request_id = request_id
        self._ahead: tuple[Any, asyncio.Task[PlannedMotion | str]] | None = None

    async def where(self, progress: JobProgress) -> ArmPlace | None:
        """Returns where the arm stands, to the bit where its last motion left it; None where nobody tells."""
        expected = await self._expected(progress)
        until = time.monotonic() + SETTLED_S
        while True:
            try:
                here = await run_in_threadpool(current_positions, self._service, self._order.cell)
            except ProblemDetails:
                return None
            if expected is None:
                return ArmPlace(None, here)
            if float(np.abs(np.subtract(here, expected.positions)).max()) <= THERE_RAD:
                return expected
            if time.monotonic() > until:  # somebody has moved it
                return ArmPlace(None, here)
            await asyncio.sleep(LOOK_S)

    async def planned(self, motion: NextMotion, start: Sequence[float]) -> PlannedMotion | str:
        """Returns a motion from joint positions (6,) [rad], or why there is none; that planned ahead if it is this one.

        A throw that cannot go on to the next pick ends at home.
        """
        task = self._begun(motion, start)
        try:
            return await asyncio.shield(task)
        except StoreError:  # it is planned again
            self.forget()
            raise

    async def plan_ahead(self, progress: JobProgress) -> None:
        """Begins to plan what comes after a progress that is expected, unless that has begun."""
        motion = progress.next_motion(progress.arm_at())
        expected = await self._expected(progress)
        if motion is not None and expected is not None:
            self._begun(motion, expected.positions)

    def _begun(self, motion: NextMotion, start: Sequence[float]) -> asyncio.Task[PlannedMotion | str]:
        """Returns the planning of a motion; what was begun for another one is dropped."""
        asked = motion, tuple(start)
        if self._ahead is None or self._ahead[0] != asked:
            self.forget()
            self._ahead = asked, asyncio.create_task(self._plan(motion, start))
        return self._ahead[1]

    def forget(self) -> None:
        """Drops what was planned ahead."""
        if self._ahead is not None:
            self._ahead[1].cancel()
            self._ahead = None

    close = forget

    async def _expected(self, progress: JobProgress) -> ArmPlace | None:
        """Returns where the last motion left the arm; None where nobody can say."""
        last = next((row for row in reversed(progress.rows) if row.result != NOT_PLANNED), None)
        if last is None or last.plan_id is None or last.result not in (*WENT, *STAYED):
            return None
        plan = await run_in_threadpool(self._service.store.plan, last.plan_id)
        assert plan is not None  # retention keeps the plans of jobs
        positions = orjson.loads(plan.trajectory)["positions"]
        return ArmPlace(progress.arm_at(), positions[-1 if last.result in WENT else 0])

    async def _plan(self, motion: NextMotion, start: Sequence[float]) -> PlannedMotion | str:
        try:
            return await self._found(motion, start)
        except REFUSALS as error:
            if motion.kind == "approach" or motion.next_pick is None:
                return str(error)
        try:
            return await self._found(replace(motion, next_pick=None), start)
        except REFUSALS as error:
            return str(error)

    async def _found(self, motion: NextMotion, start: Sequence[float]) -> PlannedMotion:
        """Returns a motion with its plan.

        Raises:
            PlannerError: there is none.
        """
        order = self._order
        target = None if motion.turn is None else order.target(motion.turn)
        request = motion_request(
            order.cell,
            start,
            order.lines,
            order.pose(motion.rises_from),
            None if target is None else order.targets[target],
            order.pose(motion.next_pick),
        )
        plan = await self._stored(read_request(request))
        if target is None:
            return PlannedMotion(motion, plan)
        place, radius_m = await run_in_threadpool(self._aim, request)
        return PlannedMotion(motion, plan, target, place, radius_m)

    async def _stored(self, request: Mapping[str, Any]) -> PlanRow:
        while True:
            try:
                return await stored_plan(
                    PlanOrder(request, self._service, None, self._request_id, asyncio.Event(), True)
                )
            except PlanningQueueFull as full:
                await asyncio.sleep(full.retry_after_s)
            except (PlanningEnded, PoolBroken):  # the service ends, and this task with it; or it has no planner now
                await asyncio.sleep(AGAIN_S)

    def _aim(self, request: Mapping[str, Any]) -> tuple[list[float], float]:
        """Returns the place of a request's target (3,) in the world, and what counts as a hit [m]."""
        problem = problem_from_request(request, self._service.cell(self._order.cell))
        assert problem.target is not None  # it is a throw at one
        return problem.target.p_W.tolist(), problem.hit_radius_m
