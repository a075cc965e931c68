"""Planners that answer at once, in any order; and the real one, in this process."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import orjson

from jobs.maps import MapDefinition
from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import JobResult
from planner.errors import Infeasible, PlannerError, SolverFailed, Violation
from store import MapRow, PlanRow, Store

SHA256 = "5" * 64


class Killed(BaseException):
    """The process is gone: nothing is stored after this."""


def definition(shape=(7, 9), resolution_m=0.1, planes=(0.0,), **changes) -> MapDefinition:
    given = {"cell": "c", "cell_sha256": SHA256, "profile": None, "planner_version": "1", "origin_m": (-0.35, 0.25)}
    given |= {"planes_z_m": planes, "shape": shape, "resolution_m": resolution_m, "robust": False}
    return MapDefinition(**{**given, **changes})


def begun(store: Store, of: MapDefinition) -> MapRow:
    return store.begin_map(of.cell, 1, of.sha256, of.document(), "me", "command")


def fake_solve(job: PlanningJob) -> PlanRecord:
    """Throws short in front; beyond x = 0 only from neighbours' releases, step by step; nowhere beyond y = 0.6."""
    x, y, _ = job.request["release"]["position"]
    if y > 0.7:
        raise Infeasible([Violation("reach", y, 0.7, "m", detail="too far", proven=True)])
    if y > 0.6 or (x > 0.0 and not job.releases):
        raise Infeasible([Violation("joint_jerk", 1.0 + x, 1.0, "rad/s^3")])
    if job.releases and min(abs(q[0] - x) for q, _ in job.releases) > 0.11:
        raise Infeasible([Violation("joint_torque", 2.0, 1.0, "N m")])
    summary = orjson.dumps({"release": {"positions": [x, y, 0, 0, 0, 0], "velocities": [0.0] * 6}})
    samples = orjson.dumps([x, y, job.releases])
    return PlanRecord(
        row=PlanRow(job.plan_id, 0.0, job.cell.name, job.cell.sha256, "fake", summary, None, samples),
        release_time_s=0.1 + abs(x) + sum(q[1] for q, _ in job.releases),
        duration_s=1.0,
        shift_early_m=0.02,
        hit_probability=0.5,
        margin=0.25,
        margin_check="b",
    )


def plan_all(
    solve: Callable[[PlanningJob], PlanRecord] = fake_solve,
    seed: int | None = None,
    kill_after: list[int] | None = None,
):
    """Returns a `plan_all` that answers in an order drawn by `seed`, and is killed after a number of answers."""

    def answers(jobs: Iterable[PlanningJob], must_stop: Callable[[], bool]) -> Iterator[JobResult]:
        numbered = list(enumerate(jobs))
        if seed is not None:
            random.Random(seed).shuffle(numbered)
        for number, job in numbered:
            if kill_after is not None:
                kill_after[0] -= 1
                if kill_after[0] < 0:
                    raise Killed
            try:
                yield JobResult(solve(job), None, number=number)
            except PlannerError as error:
                yield JobResult(None, error, number=number)
            if must_stop():
                return

    return answers


def is_cut_off(job: PlanningJob) -> bool:
    """Returns whether a job is that of the landing cell whose search does not come to its end."""
    return job.request["release"]["position"][:2] == [-0.35, 0.25]


def cut_off(job: PlanningJob) -> PlanRecord:
    """Solves as `fake_solve`, but for one landing cell, whose planner dies."""
    if is_cut_off(job):
        raise SolverFailed("the planner process died")
    return fake_solve(job)


def cut_short(job: PlanningJob) -> PlanRecord:
    """Solves as `fake_solve`, but one landing cell with the plan that its time limit left."""
    return replace(fake_solve(job), was_cut_short=is_cut_off(job))
