"""The job: all the streaming process needs for one execution, computed and checked before anything moves.

Rows are on the controller's ticks. Row m is what the arm shall do, measured, one lag after it is sent.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace

Row = list[float]

OUTCOMES = (
    "completed",
    "aborted",
    "refused",
    "protective_stop",
    "emergency_stop",
    "link_lost",
    "late",
    "tracking",
    "executor_lost",
)


@dataclass(frozen=True)
class Approach:
    """Rows of a planned way to the start; fields as those of `Job`."""

    first_clock_s: float
    q: list[Row]
    qd: list[Row]
    qdd: list[Row]
    reference_q: list[Row]
    reference_qd: list[Row]
    brake_row: list[int]
    brake_ticks: list[int]


@dataclass(frozen=True)
class Job:
    """One execution.

    Attributes:
        host: of the controller.
        mode: "speedj" or "servoj".
        dry_run: everything but motion.
        dt: one tick [s].
        lag_ticks: lag of the cell [ticks], not necessarily whole.
        first_clock_s: the plan's clock of row 0 [s]; row m is at first_clock_s + m dt.
        q, qd, qdd: rows (M, 6) of the motion.
        reference_q, reference_qd: rows (M, 6) one lag earlier: what is measured when row m is sent.
        release_row: row nearest the release; the object leaves within the next tick.
        output_row: row with which the gripper is told to open; -1: never.
        output: "tool_digital", "standard_digital" or "configurable_digital"; its index and the level that opens.
        brake_row: for every row the first row from which the certified brake may be flown.
        brake_ticks: for every row how long the brake from there takes [ticks].
        start: joint positions (6,) [rad] from which the plan begins.
        approach: rows of a planned way to them, to be streamed first; None: one straight joint move leads there.
        approach_speed, approach_acceleration: of that move [rad/s, rad/s^2].
        qd_max: what no command may exceed (6,) [rad/s].
        acceleration: passed to speedj [rad/s^2].
        feedback_gain, feedback_max: of the position error [1/s, rad/s].
        tracking_max: position error that ends the run [rad].
        watchdog_hz: least command rate the controller accepts [Hz]; None: by whether real time was granted.
        core: processor to stay on, -1: any.
        priority: of SCHED_FIFO.
        daemon_silent_s: without the daemon's pulse for so long the run brakes [s].
    """

    host: str
    mode: str
    dry_run: bool
    dt: float
    lag_ticks: float
    first_clock_s: float
    q: list[Row]
    qd: list[Row]
    qdd: list[Row]
    reference_q: list[Row]
    reference_qd: list[Row]
    release_row: int
    output_row: int
    output: str
    output_index: int
    output_level: bool
    brake_row: list[int]
    brake_ticks: list[int]
    start: Row
    approach: Approach | None
    approach_speed: float
    approach_acceleration: float
    qd_max: Row
    acceleration: float
    feedback_gain: float
    feedback_max: float
    tracking_max: float
    watchdog_hz: float | None
    core: int
    priority: int
    daemon_silent_s: float

    def write(self) -> int:
        """Returns the descriptor of an anonymous file that holds the job."""
        fd = os.memfd_create("fling-job")
        os.write(fd, json.dumps(asdict(self)).encode())
        return fd

    @classmethod
    def read(cls, fd: int) -> Job:
        """Returns the job behind an inherited descriptor."""
        fields = json.loads(os.pread(fd, os.fstat(fd).st_size, 0))
        approach = fields.pop("approach")
        return cls(**fields, approach=None if approach is None else Approach(**approach))

    def of_approach(self) -> Job:
        """Returns the job of streaming the planned way to the start: it throws nothing."""
        assert self.approach is not None
        rows = vars(self.approach)
        return replace(self, **rows, mode="speedj", output_row=-1, release_row=len(self.approach.q) - 1, approach=None)
