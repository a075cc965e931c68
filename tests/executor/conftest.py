"""A cell, a plan and its stream job: computed once, shared by the tests."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import orjson
import psutil
import pytest

from executor.preparation import prepare_job
from executor.settings import ExecutorSettings
from executor.stream_job import StreamJob
from executor.stream_process import STREAM_MODULE
from planner.answer import plan_document
from planner.approach import Approach, Brakes, find_brakes
from planner.cell import Cell, load_cell
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.stream_rows import StreamRows, sample_rows
from planner.trajectory import Trajectory
from tests.processes import children_with
from tests.waiting import until

CELLS = Path(__file__).parents[2] / "cells"
LOB = {"kind": "target", "position": [1.2, 0.3, 0.0]}


@dataclass(frozen=True)
class Prepared:
    """One throw, ready to stream."""

    problem: ThrowProblem
    trajectory: Trajectory
    document: bytes
    rows: StreamRows
    brakes: Brakes
    job: StreamJob

    @property
    def cell(self) -> Cell:
        return self.problem.cell


def settings(cell: str = "ur5e-sim", **changes: object) -> ExecutorSettings:
    """Returns settings that touch nothing."""
    return ExecutorSettings(**{"cell": cell, "cells": CELLS, "database_url": "", "data": Path("nowhere"), **changes})


def prepare(name: str) -> Prepared:
    """Returns the soonest throw in a shipped cell."""
    cell = load_cell(CELLS / f"{name}.toml")
    request = {"cell": name, "release": LOB, "release_window_s": 0.0, "backend": "ruckig", "time_limit_s": 30.0}
    answer = plan(problem_from_request(request, cell))
    problem = answer.problem
    trajectory = answer.trajectory
    rows = sample_rows(cell, trajectory, throws=True)
    row_brakes = find_brakes(cell, rows.q, rows.qd, rows.qdd, trajectory.dt)
    job = prepare_job(problem, trajectory, Approach(trajectory.q[0]), "speedj", False, settings(name))
    document = plan_document(answer, request, "id", "2026-01-01T00:00:00Z")
    data = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)
    return Prepared(problem, trajectory, data, rows, row_brakes, job)


@pytest.fixture(scope="session", params=["ur5e-sim", "ur5-sim"])
def prepared(request: pytest.FixtureRequest) -> Prepared:
    """A throw of an e-Series arm at 500 Hz, and of a CB3 arm at 125 Hz."""
    return prepare(request.param)


def waiting_process() -> psutil.Process:
    """Returns the process that waits, once it has loaded: it then ignores SIGINT, and sleeps."""
    (process,) = children_with(STREAM_MODULE)
    libraries = Path(f"/proc/{process.pid}/maps")
    until(lambda: "rtde_control" in libraries.read_text() and process.status() == "sleeping")
    return process
