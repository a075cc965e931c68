"""What workers of the tests do in place of planning. A job's request says what becomes of it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import orjson

from jobs.planning import Planned, PlanningJob
from jobs.pool import Work
from planner.cell import CellSource
from planner.errors import Infeasible, Violation

CELL = CellSource("fake", b"")


def fake_job(value: float = 0.0, **request: Any) -> PlanningJob:
    return PlanningJob(None, "", CELL, {"value": value, **request})


def fake_solve(job: PlanningJob) -> Planned:
    """Plans the square of `value`, once it has done what the request asks for."""
    asked = job.request
    time.sleep(asked.get("sleep_s", 0.0))
    if asked.get("infeasible"):
        raise Infeasible([Violation("floor", -0.1, 0.02, "m", proven=True)], {"release": {}})
    if asked.get("bug"):
        raise ZeroDivisionError("a bug")
    if "dies_once" in asked and not Path(asked["dies_once"]).exists():
        Path(asked["dies_once"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.get("dies"):
        os.kill(os.getpid(), signal.SIGKILL)
    return Planned("fake", str(os.getpid()).encode(), str(asked["value"] ** 2).encode())


def fake_load(warm_up: PlanningJob | None) -> None:
    """Loads nothing; a warm-up that kills its worker does so."""
    if warm_up is not None and "dies" in warm_up.request:
        fake_solve(warm_up)


def fake_plan(job: PlanningJob) -> Planned:
    """Returns the plan of a throw whose release time is `value`, once it has done what the request asks for."""
    samples = fake_solve(job).samples
    plan: dict[str, Any] = {"id": job.plan_id, "cell": job.cell.name, "cell_sha256": job.cell.sha256}
    plan |= {"release_time_s": job.request["value"], "duration_s": 2.0, "flight": {"speed_m_s": 1.5}}
    if "log" in job.request:
        with Path(job.request["log"]).open("a") as log:
            log.write(f"{job.request['value']}\n")
    return Planned("fake", orjson.dumps(plan), samples)


FAKE = Work(fake_load, fake_solve)
FAKE_PLANS = Work(fake_load, fake_plan)
