"""What a new observation of a target means for the execution that throws at it.

While the arm still waits at its start, a target that is found to pass elsewhere has the throw planned again, and the
new plan takes the place of the one that waits. Where none can any more, and once the motion has begun, the odds are
told, and a throw that would miss is stopped as long as the object is still held
(docs/decisions/0035-targets-that-move.md).
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from api.dependencies import RequestOrigin, Service
from api.http import Caller, ProblemDetails, translate
from api.leads import FIRST_S
from api.planning import PlanningEnded, PlanningQueueFull
from api.routes.executions import join_plan
from api.routes.plans import PlanOrder, controller_time_s, stored_plan
from jobs.pool import PoolBroken
from learning import LandingForecast, cell_with_profile, knowledge_of, prior_knowledge
from planner.answer import plan_from_document
from planner.cell import Cell
from planner.errors import CellError, PlannerError
from planner.releases.target import KNOWN_OF_TRACKED
from planner.request import states_of, with_states
from planner.stream_rows import lead_in_s
from planner.tracking import TargetObservation, TargetTrack
from planner.trajectory import Trajectory
from store import ExecutionRow, Store, StoreError, TrackedTargetRow

Vector = NDArray[np.float64]

REPLAN_SHARE = 0.2  # [-] of the room of a hit by which the meeting place moves before a waiting throw is planned again
WAITING = ("queued", "preparing", "approaching")  # states before the motion
WAITS_AT_MOST_S = 15.0  # [s] a throw waits for 10 s at most, and is over some seconds later
LOOK_S = 0.2  # [s] between two looks for an executor that is not heard of
FORECASTS_KEPT = 8  # of plans: one a cell that throws at a tracked target
NO_PLAN = (ProblemDetails, PlannerError, PlanningEnded, PlanningQueueFull, PoolBroken, StoreError, CellError)
log = logging.getLogger("fling")


@dataclass(frozen=True)
class FollowedThrow:
    """An execution that throws at a tracked target, as of the target's last observation.

    Attributes:
        row: the execution.
        summary: of the plan that it makes, or waits to begin.
        height_m: of the target, in the world [m].
        now_s: the controller's time [s].
        lead_in_s: how long before its start the plan's first row is sent [s].
        miss_m: from where the plan meets the target to where that is expected then [m].
        room_m: distance from the target that counts as a hit [m].
        hit_probability: as it is now [-].
        motion: of its plan.
    """

    row: ExecutionRow
    summary: Mapping[str, Any]
    height_m: float
    now_s: float
    lead_in_s: float
    miss_m: float
    room_m: float
    hit_probability: float
    motion: Trajectory

    @property
    def waits(self) -> bool:
        """Whether the motion has not begun."""
        return self.row.state in WAITING and self.now_s < self.summary["starts_at_s"]

    @property
    def left_s(self) -> float:
        """Time until the first row of the plan that waits is sent [s]; until then another can take its place."""
        return self.summary["starts_at_s"] - self.lead_in_s - self.now_s

    def can_be_replanned(self, lead_s: float) -> bool:
        """Returns whether another plan can still take the place of the one that waits, in `lead_s` [s]."""
        return self.waits and lead_s < self.left_s

    @property
    def holds_object(self) -> bool:
        """Whether the gripper has not been told to open yet."""
        return self.now_s < self.summary["starts_at_s"] + self.summary["release"]["command_time_s"]


async def follow_target(
    service: Service,
    target: TrackedTargetRow,
    caller: Caller,
    origin: RequestOrigin,
    contradicting: TargetObservation | None = None,
) -> None:
    """Does for the execution that throws at a target, if there is one, what its new observation asks for.

    Args:
        service: the service.
        target: as of the observation.
        caller, origin: of the observation.
        contradicting: the observation, where it was refused as it is far from what was expected: if the target is
            there, nobody knows how it got there.
    """
    throw = await run_in_threadpool(_followed, service, target, contradicting)
    if throw is None:
        return
    is_stopped = False
    if throw.can_be_replanned(_lead_s(service, throw)):
        if contradicting is None and throw.miss_m > REPLAN_SHARE * throw.room_m:
            service.replanning.begin(target.cell, _replan(service, target, caller, origin))
        elif throw.miss_m > throw.room_m:
            _stop_in_time(service, target, caller, origin, contradicting)
    elif throw.miss_m > throw.room_m and throw.holds_object:
        is_stopped = True
        await _stop(service, throw, caller, origin)
    told = {
        "target": target.id,
        "observed_at_s": contradicting.observed_at_s if contradicting else target.track["observed_at_s"],
        "miss_m": throw.miss_m,
        "room_m": throw.room_m,
        "hit_probability": throw.hit_probability,
        "stopped": is_stopped,
    }
    await run_in_threadpool(service.store.add_event, throw.row.id, "target", told)


async def _stop(service: Service, throw: FollowedThrow, caller: Caller, origin: RequestOrigin) -> None:
    await service.stopping.at_executor(throw.row.id, caller.name)
    await run_in_threadpool(service.store.request_abort, throw.row.id, origin.act(caller, "abort"))


def _stop_in_time(
    service: Service,
    target: TrackedTargetRow,
    caller: Caller,
    origin: RequestOrigin,
    contradicting: TargetObservation | None = None,
) -> None:
    """Has the throw that waits stopped once no other plan can take its place, unless the target is near by then.

    It may never be observed again; one that was last seen elsewhere than expected is where it was seen.
    """

    async def wait() -> None:
        ends_s = time.monotonic() + WAITS_AT_MOST_S
        while time.monotonic() < ends_s:
            try:
                throw = await run_in_threadpool(_followed, service, target, contradicting)
                is_over = await run_in_threadpool(service.store.open_execution, target.cell) is None
            except NO_PLAN:  # the target was forgotten, or the database is away
                throw = None
                is_over = False
            if is_over:
                return
            if throw is None:  # the executor has not been heard of just now
                await asyncio.sleep(LOOK_S)
                continue
            if throw.miss_m <= throw.room_m or not throw.holds_object:
                return
            left_s = throw.left_s - service.replan_leads.lead_s(target.cell)
            if not throw.waits or left_s <= 0.0:
                await _stop(service, throw, caller, origin)
                return
            await asyncio.sleep(left_s)

    service.replanning.begin(f"{target.id}, in time", wait())


def _lead_s(service: Service, throw: FollowedThrow) -> float:
    """Returns how long before its start a waiting throw can be planned again [s].

    Once a call has taken longer than the throw still waits, it is forgotten: it must not keep others out.
    """
    leads = service.replan_leads
    lead_s = leads.lead_s(throw.row.cell)
    if lead_s > FIRST_S and throw.waits and not throw.can_be_replanned(lead_s):
        leads.shorten(throw.row.cell)
    return lead_s


async def _replan(service: Service, target: TrackedTargetRow, caller: Caller, origin: RequestOrigin) -> None:
    """Plans again to where the target is now expected, and has the plan take the place of the one that waits.

    Until that is near enough to the last observation. What is refused leaves the waiting plan as it is, to be stopped
    in time if it would miss.
    """
    cell = target.cell
    try:
        while True:
            begun_s = time.monotonic()
            lead_s = service.replan_leads.lead_s(cell)
            throw = await run_in_threadpool(_followed, service, target)
            if throw is None or throw.row.state != "approaching" or not throw.can_be_replanned(lead_s):
                return
            if throw.miss_m <= REPLAN_SHARE * throw.room_m:
                return
            body = _request_again(throw, target.id, throw.now_s + lead_s + throw.lead_in_s)
            order = PlanOrder(body, service, None, origin.request_id, asyncio.Event(), False, nearby=throw.motion)
            plan = await stored_plan(order)
            audit = origin.act(caller, "replace")
            try:
                await run_in_threadpool(join_plan, service, throw.row, plan, plan.id, caller.name, audit)
            finally:
                service.replan_leads.note(cell, time.monotonic() - begun_s)
    except NO_PLAN as error:
        fields = {"cell": cell, "target": target.id, "problem": translate(error).name}
        log.info("a waiting throw was not planned again: %s", error, extra={"fields": fields})
    finally:
        _stop_in_time(service, target, caller, origin)


def _request_again(throw: FollowedThrow, target_id: str, not_before_s: float) -> dict[str, Any]:
    """Returns the request of a plan, for where its target is now expected, with an earliest start [s]."""
    request = throw.summary["request"]
    (path,) = _tracked(request, target_id)
    state = {name: value for name, value in states_of(request)[path].items() if name not in KNOWN_OF_TRACKED}
    state["position"] = {"target": target_id, "height_m": throw.height_m}
    starts_s = max(not_before_s, request["starts_not_before_s"])
    return {**with_states(request, {path: state}), "starts_not_before_s": starts_s}


def _tracked(request: Mapping[str, Any], target_id: str) -> dict[str, Mapping[str, Any]]:
    """Returns the state of a request that throws at a tracked target, by its field; empty where none does."""
    return {path: state for path, state in states_of(request).items() if state.get("tracked_target") == target_id}


def _followed(
    service: Service, target: TrackedTargetRow, contradicting: TargetObservation | None = None
) -> FollowedThrow | None:
    """Returns the throw at a target, as of what is stored of both now; None where there is none, or it has landed."""
    id = service.store.open_execution(target.cell)
    row = None if id is None else service.store.execution(id)
    if row is None or row.state == "finished" or row.dry_run or row.abort_requested_at is not None:
        return None
    joined = row.joined
    plan = service.store.plan_summary(joined[-1]["plan_id"] if joined else row.plan_id)
    summary = {} if plan is None else orjson.loads(plan.summary)
    asked = _tracked(summary.get("request", {}), target.id)
    odds = summary.get("hit_probability")
    if plan is None or not asked or "starts_at_s" not in summary or odds is None:
        return None
    (state,) = asked.values()
    try:
        now_s = controller_time_s(service, target.cell)
    except ProblemDetails:  # nobody executes anything
        return None
    track = TargetTrack.from_document(service.store.target(target.cell, target.id).track)
    lands_s = summary["starts_at_s"] + summary["release_time_s"] + summary["flight"]["time_of_flight_s"]
    if lands_s <= max(track.observed_at_s, now_s):
        return None
    planned = _place(service, target.cell, state, summary["request"]["frame"], lands_s)
    expected = track.after(lands_s - track.observed_at_s)
    if contradicting is not None and contradicting.observed_at_s > track.observed_at_s:
        elsewhere = replace(track, position=contradicting.position, velocity=contradicting.velocity or track.velocity)
        expected = elsewhere.after(lands_s - contradicting.observed_at_s)
    place = np.array(expected.position[:2])
    beside, sent_before_s, motion = _made(service.store, service.cell(target.cell), plan.id)
    beside = beside.beside_target(expected.uncertainty.position_std_m)
    return FollowedThrow(
        row=row,
        summary=summary,
        height_m=float(planned[2]),
        now_s=now_s,
        lead_in_s=sent_before_s,
        miss_m=float(np.linalg.norm(place - planned[:2])),
        room_m=odds["radius_m"],
        hit_probability=beside.hit_probability(place, odds["radius_m"]),
        motion=motion,
    )


def _place(service: Service, cell: str, state: Mapping[str, Any], frame: str, at_s: float) -> Vector:
    """Returns where the target of a request's state is at a time [s], in the world (3,) [m]."""
    place = np.array(state["position"]) + (at_s - state["observed_at_s"]) * np.array(state["velocity"])
    X_WR = service.cell(cell).X_WB if frame == "base" else np.eye(4)
    return X_WR[:3, :3] @ place + X_WR[:3, 3]


@lru_cache(maxsize=FORECASTS_KEPT)
def _made(store: Store, cell: Cell, plan_id: str) -> tuple[LandingForecast, float, Trajectory]:
    """Returns where throws of a plan land beside its target, as when it was made, its `lead_in_s`, and its motion."""
    plan = store.plan(plan_id)
    assert plan is not None  # retention keeps the plans of executions
    document = orjson.loads(plan.document)
    profile = None if document["profile"] is None else store.profile(document["profile"])
    learnt = None if profile is None else orjson.loads(profile.document)
    problem, trajectory = plan_from_document(document, cell_with_profile(cell, learnt))
    known = prior_knowledge(cell) if learnt is None else knowledge_of(learnt)
    return known.predicted(problem, trajectory), lead_in_s(problem, trajectory), trajectory
