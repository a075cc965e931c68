"""The plan on the controller's ticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.stream_rows import sample_rows
from tests.executor.conftest import Prepared


def test_the_gripper_command_falls_on_a_tick(prepared: Prepared) -> None:
    cell = prepared.cell
    rows = prepared.rows
    trajectory = prepared.trajectory
    opens = rows.first_clock_s + rows.output_row * trajectory.dt  # when the output changes: one lag after it was sent
    assert opens + cell.gripper.delay_s == pytest.approx(trajectory.release_time_s, abs=1e-12)


def test_the_stream_begins_and_ends_at_rest(prepared: Prepared) -> None:
    rows = prepared.rows
    trajectory = prepared.trajectory
    lag = prepared.cell.timing.lag_s
    assert rows.first_clock_s <= -lag
    assert not rows.qd[0].any()
    assert not rows.qd[-1].any()
    assert rows.q[0] == pytest.approx(trajectory.q[0])
    assert rows.q[-1] == pytest.approx(trajectory.q[-1])
    assert rows.reference_q[-1] == pytest.approx(trajectory.q[-1])


def test_a_gripper_slower_than_the_launch_is_commanded_before_it(prepared: Prepared) -> None:
    cell = replace(prepared.cell, gripper=replace(prepared.cell.gripper, delay_s=1.5))
    rows = sample_rows(cell, prepared.trajectory, throws=True)
    assert rows.output_row >= 0
    opens = rows.first_clock_s + rows.output_row * prepared.trajectory.dt
    assert opens == pytest.approx(prepared.trajectory.release_time_s - 1.5)
    assert np.abs(rows.qd[: rows.output_row]).max() == 0.0


def test_a_move_that_ends_at_rest_commands_no_gripper(prepared: Prepared) -> None:
    assert sample_rows(prepared.cell, prepared.trajectory, throws=False).output_row == -1
