"""The stream job of a motion in which two grippers let go: commands on their ticks, stops that hold what is held."""

from __future__ import annotations

import math
from pathlib import Path

import orjson
import pytest

from executor.preflight import ExecutionRefused, prove_plan
from executor.preparation import prepare_job
from executor.settings import ExecutorSettings
from executor.stream_job import StreamJob
from planner.answer import plan_document
from planner.approach import Approach
from planner.controller_program import NoProgram
from planner.planning import Plan, plan
from planner.request import problem_from_request
from tests.planner.two_grippers import cell_of_two, two_throws


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan(problem_from_request(two_throws(), cell_of_two()))


@pytest.fixture(scope="module")
def job(made: Plan) -> StreamJob:
    return prepared(made, "speedj")


def prepared(made: Plan, mode: str) -> StreamJob:
    settings = ExecutorSettings("two", Path("cells"), "", Path("nowhere"))
    return prepare_job(made.problem, made.trajectory, Approach(made.trajectory.q[0]), mode, False, settings)


@pytest.mark.slow
def test_each_gripper_is_told_one_delay_and_one_lag_before_its_release(made: Plan, job: StreamJob) -> None:
    (second,) = job.switches
    released_s = [index * job.dt for index in made.trajectory.passed]
    assert (job.output, job.output_index) == ("tool_digital", 0)
    assert (second.output, second.index, second.level) == ("standard_digital", 1, True)
    sent_s = [job.first_clock_s + (row - job.lag_ticks) * job.dt for row in (job.output_row, second.row)]
    assert sent_s[0] == pytest.approx(released_s[0] - 0.040 - 0.020, abs=1e-9)
    assert sent_s[1] == pytest.approx(released_s[1] - 0.030 - 0.020, abs=0.5 * job.dt + 1e-9)


def test_a_stop_takes_the_command_back_until_the_object_has_left(job: StreamJob) -> None:
    (second,) = job.switches
    assert job.stop_levels(0, row=second.row - 1) == []  # it was not told to open
    for row in (second.row + 1, second.held_until - 1):
        (back,) = job.stop_levels(1, row=row)
        assert (back.line, back.level) == (second.line, False)
    assert job.stop_levels(1, row=second.held_until) == []  # its object has left
    assert job.stop_levels(1) == []  # no stop
    left_s = job.first_clock_s + (second.held_until - job.lag_ticks) * job.dt
    planned_s = job.first_clock_s + second.row * job.dt + 0.030
    assert left_s == pytest.approx(planned_s, abs=2.0 * job.dt)
    assert not math.isnan(left_s)


def test_a_job_keeps_its_switches_on_its_way_to_the_stream(job: StreamJob) -> None:
    again = StreamJob.unpacked(memoryview(job.packed()))
    assert again.switches == job.switches


def test_a_program_of_the_controller_does_not_let_several_go(made: Plan) -> None:
    with pytest.raises(NoProgram, match="mode: a program lets go of one object"):
        prepared(made, "script")


def test_the_second_checker_proves_it(made: Plan) -> None:
    document = plan_document(made, {"cell": "two", **two_throws()}, "id", "now")
    prove_plan(orjson.dumps(document), made.problem.cell)
    for key in ("index", "end_index"):
        document["passages"][1][key] += 1
    with pytest.raises(ExecutionRefused, match=r"the plan is violated: .*landing.*second"):
        prove_plan(orjson.dumps(document), made.problem.cell)
