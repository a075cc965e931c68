"""Planners that answer at once, in any order; and the real one, in this process."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import orjson

from jobs.maps import MapDefinition
from jobs.planning import Planned, PlanningJob, refusal_of
from jobs.pool import JobResult
from planner.errors import CUT_SHORT, Infeasible, PlannerError, SolverFailed, Violation
from store import MapRow, Store

SHA256 = "5" * 64


class Killed(BaseException):
    """The process is gone: nothing is stored after this."""


def definition(shape=(7, 9), resolution_m=0.1, planes=(0.0,), **changes) -> MapDefinition:
    given = {"cell": "c", "cell_sha256": SHA256, "profile": None, "planner_version": "1", "origin_m": (-0.35, 0.25)}
    given |= {"planes_z_m": planes, "shape": shape, "resolution_m": resolution_m, "robust": False}
    return MapDefinition(**{**given, **changes})


def begun(store: Store, of: MapDefinition) -> MapRow:
    return store.begin_map(of.cell, 1, of.sha256, of.document(), "me", "command")


def fake_solve(job: PlanningJob) -> Planned:
    """Throws short in front; beyond x = 0 only from neighbours' releases, step by step; nowhere beyond y = 0.6."""
    x, y, _ = job.request["release"]["position"]
    if y > 0.7:
        raise Infeasible([Violation("reach", y, 0.7, "m", detail="too far", proven=True)])
    if y > 0.6 or (x > 0.0 and not job.releases):
        raise Infeasible([Violation("joint_jerk", 1.0 + x, 1.0, "rad/s^3")])
    if job.releases and min(abs(q[0] - x) for q, _ in job.releases) > 0.11:
        raise Infeasible([Violation("joint_torque", 2.0, 1.0, "N m")])
    summary = {
        "release_time_s": 0.1 + abs(x) + sum(q[1] for q, _ in job.releases),
        "release": {"positions": [x, y, 0, 0, 0, 0], "velocities": [0.0] * 6},
        "flight": {"landing_shift_10ms_m": {"early": 0.02, "late": None}},
        "certificate": {"checks": [{"name": "b", "margin": 1.0, "limit": 4.0}, {"name": "a", "margin": 2, "limit": 0}]},
        "hit_probability": {"value": 0.5},
        "solver": {"status": "fake"},
    }
    return Planned("fake", orjson.dumps(summary), orjson.dumps([x, y, job.releases]))


def plan_all(
    solve: Callable[[PlanningJob], Planned] = fake_solve, seed: int | None = None, kill_after: list[int] | None = None
):
    """Returns a `plan_all` that answers in an order drawn by `seed`, and is killed after a number of answers."""

    def answers(jobs: Iterable[PlanningJob]) -> Iterator[JobResult]:
        numbered = list(enumerate(jobs))
        if seed is not None:
            random.Random(seed).shuffle(numbered)
        for number, job in numbered:
            if kill_after is not None:
                kill_after[0] -= 1
                if kill_after[0] < 0:
                    raise Killed
            try:
                yield JobResult(number, solve(job), None)
            except PlannerError as error:
                yield JobResult(number, None, refusal_of(error))

    return answers


def is_cut_off(job: PlanningJob) -> bool:
    """Returns whether a job is that of the landing cell whose search does not come to its end."""
    return job.request["release"]["position"][:2] == [-0.35, 0.25]


def cut_off(job: PlanningJob) -> Planned:
    """Solves as `fake_solve`, but for one landing cell, whose planner dies."""
    if is_cut_off(job):
        raise SolverFailed("the planner process died")
    return fake_solve(job)


def cut_short(job: PlanningJob) -> Planned:
    """Solves as `fake_solve`, but one landing cell with the plan that its time limit left."""
    planned = fake_solve(job)
    if is_cut_off(job):
        summary = orjson.loads(planned.summary) | {"solver": {"status": f"fake; {CUT_SHORT}"}}
        return replace(planned, summary=orjson.dumps(summary))
    return planned
