"""The schedule: rows of the plan, and the brake from any of them."""

from __future__ import annotations

import numpy as np
import pytest

from executor.streaming.loop import Schedule
from planner.approach import brake_path
from tests.executor.conftest import Prepared


def moving_row(prepared: Prepared, share: float) -> int:
    """Returns a row in the launch, and one with a brake of its own."""
    row = int(share * prepared.job.release_row)
    return prepared.job.brake_row[row]


def test_on_the_plan_a_row_is_the_plans(prepared: Prepared) -> None:
    schedule = Schedule(prepared.job)
    job = prepared.job
    for row in (0, job.release_row, len(job.q) - 1):
        q, qd, _ = prepared.trajectory.at(job.first_clock_s + row * job.dt)
        assert schedule.command(row) == (pytest.approx(q), pytest.approx(qd, abs=1e-12))


def test_the_reference_is_the_plan_one_lag_before(prepared: Prepared) -> None:
    schedule = Schedule(prepared.job)
    job = prepared.job
    for row in (20, job.release_row, job.release_row + 5):
        q, _, _ = prepared.trajectory.at(job.first_clock_s + (row - job.lag_ticks) * job.dt)
        assert schedule.reference(row)[0] == pytest.approx(q)


@pytest.mark.parametrize("share", [0.3, 0.7, 1.0])
def test_the_brake_goes_on_continuously_and_ends_at_rest(prepared: Prepared, share: float) -> None:
    schedule = Schedule(prepared.job)
    job = prepared.job
    start = moving_row(prepared, share)
    before = [schedule.command(row) for row in range(start + 1)]
    schedule.divert(start)
    after = [schedule.command(row) for row in range(start + 1, schedule.last + 1)]
    q, qd = (np.array(x) for x in zip(*before, *after, strict=True))
    change = np.abs(np.diff(qd, axis=0)[start - 1 :]).max() / job.dt
    assert change < 1.05 * prepared.cell.robot.qdd_max.max()
    assert qd[-1] == pytest.approx(np.zeros(6), abs=1e-9)
    travelled = np.sum((qd[start:-1] + qd[start + 1 :]) / 2.0, axis=0) * job.dt  # the trapezoid rule: what speedj does
    assert q[-1] - q[start] == pytest.approx(travelled, abs=2e-3)


def test_the_streamed_brake_is_the_checked_brake(prepared: Prepared) -> None:
    schedule = Schedule(prepared.job)
    rows = prepared.rows
    start = moving_row(prepared, 0.8)
    schedule.divert(start)
    ticks = prepared.brakes.ticks[start]
    one = slice(start, start + 1)
    duration = np.array([ticks * prepared.job.dt])
    q, qd, _ = brake_path(rows.q[one], rows.qd[one], rows.qdd[one], duration, np.arange(1, ticks + 1) / ticks)
    for i in range(ticks):
        assert schedule.command(start + 1 + i) == (pytest.approx(q[0, i]), pytest.approx(qd[0, i], abs=1e-12))


def test_while_braking_the_reference_follows_one_lag_behind(prepared: Prepared) -> None:
    schedule = Schedule(prepared.job)
    job = prepared.job
    rows = prepared.rows
    start = moving_row(prepared, 0.8)
    schedule.divert(start)
    one = slice(start, start + 1)
    ticks = prepared.brakes.ticks[start]
    duration = np.array([ticks * job.dt])
    after = np.arange(np.ceil(job.lag_ticks), ticks, dtype=int)  # sent so many ticks after the brake began
    u = (after - job.lag_ticks) / ticks
    q, _, _ = brake_path(rows.q[one], rows.qd[one], rows.qdd[one], duration, u)
    for i, ticks_after in enumerate(after[1:], 1):
        assert schedule.reference(start + ticks_after)[0] == pytest.approx(q[0, i])


def test_only_the_first_diversion_counts(prepared: Prepared) -> None:
    schedule = Schedule(prepared.job)
    schedule.divert(moving_row(prepared, 0.5))
    first = schedule.diverted
    schedule.divert(moving_row(prepared, 0.9))
    assert schedule.diverted == first


def test_a_brake_that_failed_its_check_is_put_off(prepared: Prepared) -> None:
    job = prepared.job
    rows = list(job.brake_row)
    rows[50:60] = [60] * 10
    schedule = Schedule(type(job)(**{**vars(job), "brake_row": rows}))
    schedule.divert(52)
    assert schedule.diverted == 60
