"""From a plan to a job: the plan sampled on the controller's ticks, and a way to rest from each of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.job import Approach, Job
from executor.punctuality import silence_limit
from executor.settings import PRIORITY, Settings
from planner.approach import APPROACH_ACCELERATION, APPROACH_SPEED, Brakes
from planner.cell import Cell
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

LEAD_IN_S = 0.020  # [s] at rest before the plan begins: the stream is running smoothly by then
SETTLE_S = 0.060  # [s] at rest after it: the measured motion, one lag behind, comes to its end
FEEDBACK_GAIN = 5.0  # [1/s] with a lag of 20 ms the loop's phase is 0.1 rad: far from ringing (rtde.md, section 11)
FEEDBACK_MAX = 0.05  # [rad/s] bound of the correction
TRACKING_MAX_RAD = 0.05  # [rad] 20 times the error of a gap of 10 ms at 15 rad/s^2


@dataclass(frozen=True)
class Rows:
    """The plan on the controller's ticks.

    Attributes:
        first_clock_s: the plan's clock of row 0 [s].
        q, qd, qdd: (M, 6).
        reference_q, reference_qd: (M, 6) one lag earlier.
        release_row: nearest to the release.
        output_row: with which the gripper is told; -1 for a move that ends at rest.
    """

    first_clock_s: float
    q: Vector
    qd: Vector
    qdd: Vector
    reference_q: Vector
    reference_qd: Vector
    release_row: int
    output_row: int


def rows_of(cell: Cell, trajectory: Trajectory, throws: bool) -> Rows:
    """Samples the plan so that the gripper's command falls on a tick exactly; at rest before and after."""
    dt, lag = trajectory.dt, cell.timing.lag_s
    opens = trajectory.release_time_s - cell.gripper.delay_s  # clock at which the output must physically change
    anchor = opens if throws else 0.0
    first = anchor - math.ceil((anchor - min(anchor, 0.0) + lag + LEAD_IN_S) / dt) * dt
    count = math.ceil((trajectory.duration_s + lag + SETTLE_S - first) / dt) + 1
    clock = first + np.arange(count) * dt
    q, qd, qdd = trajectory.at(clock)
    still = (clock <= 0.0) | (clock >= trajectory.duration_s)
    qd[still], qdd[still] = 0.0, 0.0
    reference_q, reference_qd, _ = trajectory.at(clock - lag)
    return Rows(
        first,
        q,
        qd,
        qdd,
        reference_q,
        reference_qd,
        round((trajectory.release_time_s - first) / dt),
        round((opens - first) / dt) if throws else -1,
    )


def approach_of(rows: Rows, brakes: Brakes) -> Approach:
    """Returns a planned way to the start, for a job."""
    return Approach(**_streamed(rows, brakes))


def _streamed(rows: Rows, brakes: Brakes) -> dict[str, Any]:
    """Returns what a motion's streaming needs of its rows and their brakes, by the names of `Job` and `Approach`."""
    return {
        "first_clock_s": rows.first_clock_s,
        "q": rows.q.tolist(),
        "qd": rows.qd.tolist(),
        "qdd": rows.qdd.tolist(),
        "reference_q": rows.reference_q.tolist(),
        "reference_qd": rows.reference_qd.tolist(),
        "brake_row": brakes.row.tolist(),
        "brake_ticks": brakes.ticks.tolist(),
    }


def make_job(
    cell: Cell, rows: Rows, brakes: Brakes, approach: Approach | None, mode: str, dry_run: bool, settings: Settings
) -> Job:
    """Returns the job of one execution; everything in it has been judged."""
    dt = 1.0 / cell.robot.sample_rate_hz
    return Job(
        host=cell.link.host,
        mode=mode,
        dry_run=dry_run,
        dt=dt,
        lag_ticks=cell.timing.lag_s / dt,
        **_streamed(rows, brakes),
        release_row=rows.release_row,
        output_row=rows.output_row,
        output=cell.gripper.output,
        output_index=cell.gripper.index,
        output_level=cell.gripper.open_level,
        start=rows.q[0].tolist(),
        approach=approach,
        approach_speed=settings.approach_pace * APPROACH_SPEED,
        approach_acceleration=settings.approach_pace**2 * APPROACH_ACCELERATION,
        qd_max=cell.robot.qd_max.tolist(),
        acceleration=float(np.min(cell.robot.qdd_max)),
        feedback_gain=FEEDBACK_GAIN,
        feedback_max=FEEDBACK_MAX,
        tracking_max=TRACKING_MAX_RAD,
        watchdog_hz=settings.watchdog_hz,
        core=settings.core,
        priority=PRIORITY,
        daemon_silent_s=silence_limit(),
    )
