"""A motion that runs inside the controller: it lands as the streamed one, and stops where nobody is left."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil
import pytest

from tests.system.fault_matrix import FAULT, PHASE, run_cell
from tests.system.rig import LOB, NUDGE, Rig, rows_of

ALIKE_M = 1e-3  # [m] from where the same throw lands streamed
REST_S = 0.150  # [s] of the controller's time from the fault to rest: the promise of docs/executor.md
FAST_RAD_S = 2.3
LOSSY = {"role": "every", "jitter_s": 0.02, "drop": 0.05}

CELLS = [
    ("approach", "stream killed"),
    ("launch", "daemon and stream killed"),
    ("launch", "every command lost"),
    ("before the command", "program stopped"),
    ("after the command", "cable out"),
    ("flight", "protective stop"),
    ("brake", "another client's program"),
    ("way home", "speed slider at 50 %"),
]


def landing(rig: Rig, mode: str) -> np.ndarray:
    row = rig.quiet_throw(LOB, mode)
    assert row.outcome == "completed", row.reason
    assert row.metrics is not None and row.metrics["missed_ticks"] == 0
    return np.array(row.metrics["landing_point"])


def test_a_throw_lands_as_the_streamed_one(rig: Rig) -> None:
    assert landing(rig, "script") == pytest.approx(landing(rig, "speedj"), abs=ALIKE_M)


@pytest.mark.slow
def test_its_recording_is_that_of_a_streamed_run(rig: Rig) -> None:
    row = rig.quiet_throw(LOB, "script")
    recording = rig.store.recording(row.id)
    assert recording is not None and row.metrics is not None
    header, numbers = rows_of(recording.csv)
    clock = numbers[:, header.index("clock_s")]
    assert np.diff(clock).min() > 0.0
    assert row.metrics["tracking_error_max_rad"] < 1e-3
    assert row.metrics["timing"]["lag_s"] == pytest.approx(rig.cell.timing.lag_s, abs=2e-3)


@pytest.mark.slow
def test_the_output_changes_when_the_plan_says(rig: Rig) -> None:
    row = rig.quiet_throw(LOB, "script")
    metrics = row.metrics
    assert metrics is not None
    motion = rig.motion(row.id)
    opened = motion.release_time_s - rig.cell.gripper.delay_s
    assert metrics["gripper_commanded_s"] == pytest.approx(opened - rig.cell.timing.lag_s, abs=1e-3)
    assert metrics["gripper_opened_s"] == pytest.approx(motion.release_time_s, abs=motion.dt)


@pytest.mark.slow
def test_through_a_link_that_loses_and_delays_it_lands_all_the_same(rig: Rig) -> None:
    quiet = landing(rig, "script")
    rig.throw_when_ready(NUDGE)
    rig.fault("disturb_connection", **LOSSY)
    assert landing(rig, "script") == pytest.approx(quiet, abs=ALIKE_M)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_its_daemon_the_arm_rests(rig: Rig, number: signal.Signals) -> None:
    assert rig.executor is not None
    rests(rig, psutil.Process(rig.executor.pid).send_signal, number)


def test_without_a_link_the_arm_rests(rig: Rig) -> None:
    rests(rig, rig.fault, "offline")


def rests(rig: Rig, cause: Callable[[Any], object], argument: Any) -> None:
    """Causes a fault in mid-launch; the arm rests in time, and the execution tells of it."""
    id = PHASE["launch"].begin(rig, "script")
    PHASE["launch"].await_moment(rig, id)
    assert rig.speed() > FAST_RAD_S
    at = rig.state()["t"]
    cause(argument)
    rest_s = rig.rest_time(at)
    rig.revive()
    rig.recover()
    row = rig.end(id)
    assert row.outcome in ("executor_lost", "link_lost"), row.reason
    assert rest_s < REST_S


def test_an_abort_flies_the_verified_brake_and_latches_nothing(rig: Rig) -> None:
    id = PHASE["launch"].begin(rig, "script")
    PHASE["launch"].await_moment(rig, id)
    rig.store.request_abort(id)
    row = rig.end(id)
    assert row.outcome == "aborted", row.reason
    assert rig.state()["gripper_holds"] is not None
    assert not rig.is_latched()


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "fault"), CELLS)
def test_a_fault(rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(rig, PHASE[phase], FAULT[fault], "script").broken() == []
