"""What workers of the tests do in place of planning. A job's request says what becomes of it."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson

from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import Work
from planner.cell import CellSource
from planner.errors import Infeasible, Violation
from planner.progress import Observer, Progress
from store import PlanRow

CELL = CellSource("fake", b"")
STEP_S = 0.01  # [s] of a search that tells of its steps


def fake_job(value: float = 0.0, **request: Any) -> PlanningJob:
    return PlanningJob(None, 0.0, CELL, {"value": value, **request})


def fake_solve(job: PlanningJob, observer: Observer | None = None) -> PlanRecord:
    """Plans the square of `value`, once it has done what the request asks for."""
    asked = job.request
    time.sleep(asked.get("sleep_s", 0.0))
    for step in range(asked.get("steps", 0)):
        time.sleep(STEP_S)
        assert observer is not None
        observer(Progress("search", step + 1, None, 0.0))
    if asked.get("infeasible"):
        raise Infeasible([Violation("floor", -0.1, 0.02, "m", proven=True)], {"release": {}})
    if asked.get("bug"):
        raise ZeroDivisionError("a bug")
    if "dies_once" in asked and not Path(asked["dies_once"]).exists():
        Path(asked["dies_once"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.get("dies"):
        os.kill(os.getpid(), signal.SIGKILL)
    samples = str(asked["value"] ** 2).encode()
    row = PlanRow(
        job.plan_id or "", 0.0, job.cell.name, job.cell.sha256, "fake", str(os.getpid()).encode(), None, samples
    )
    return PlanRecord(row, asked["value"], 2.0, release_speed_m_s=1.5)


def fake_load(warm_up: PlanningJob | None) -> None:
    """Loads nothing; a warm-up that kills its worker does so."""
    if warm_up is not None and "dies" in warm_up.request:
        fake_solve(warm_up)


LOADED: list[str] = []  # cells that this process was warmed up for


def fake_load_noted(warm_up: PlanningJob | None) -> None:
    """Notes what the worker was warmed up for."""
    LOADED.extend([] if warm_up is None else [warm_up.cell.name])


def fake_plan_once_loaded(job: PlanningJob, observer: Observer | None) -> PlanRecord:
    """Plans in a worker that was warmed up for the job's cell, and in no other."""
    if [job.cell.name] != LOADED:
        raise Infeasible([Violation("loading", 0.0, 1.0, "1")])
    return fake_plan(job, observer)


def fake_plan(job: PlanningJob, observer: Observer | None) -> PlanRecord:
    """Returns the plan of a throw whose release time is `value`, once it has done what the request asks for."""
    planned = fake_solve(job, observer)
    if "log" in job.request:
        with Path(job.request["log"]).open("a") as log:
            log.write(f"{job.request['value']}\n")
    return replace(planned, row=replace(planned.row, created_at=time.time(), summary=orjson.dumps({"id": job.plan_id})))


FAKE = Work(fake_load, fake_solve, niceness=0)
FAKE_PLANS = Work(fake_load, fake_plan)
