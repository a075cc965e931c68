"""The wait at the plan's start for the tick at which a plan to a target that moves begins."""

from __future__ import annotations

from executor.shared_memory import PULSE
from executor.stream_job import StreamJob
from executor.streaming.clock import ControllerClock
from executor.streaming.rtde_connection import POSITION_LIMITS, RtdeConnection
from executor.streaming.state_checks import StopRequests

AHEAD = 1.5  # [ticks] before the first row's: the motion's own clock waits for the next one


def first_row_s(job: StreamJob) -> float | None:
    """Returns the controller's time at which row 0 is due [s]; None of a plan that starts when it is executed.

    A row is the state that is measured a lag after it is sent.
    """
    return None if job.starts_at_s is None else job.starts_at_s + job.first_clock_s - job.lag_ticks * job.dt


def await_start(connection: RtdeConnection, job: StreamJob, requests: StopRequests) -> tuple[str, str] | None:
    """Holds the arm until the tick before the first row's; returns outcome and reason of an early end, at rest.

    Raises:
        StreamFault: the connection failed.
    """
    due_s = first_row_s(job)
    if due_s is None:
        return None
    clock = ControllerClock(connection, job.dt)
    while clock.stamp < due_s - AHEAD * job.dt:
        clock.wait()
        connection.read()
        connection.check()
        connection.gripper.cycle()
        if job.mode == "servoj":
            connection.servo(list(job.q[0]), POSITION_LIMITS)
        else:
            connection.speed([0.0] * 6)
        connection.memory.fields[PULSE] = clock.host_s
        if (early := requests.pending()) is not None:
            return early
    late_s = clock.stamp - due_s
    if late_s > 0.5 * job.dt:
        return "refused", f"too late: the plan was to start {1e3 * late_s:.0f} ms ago, and its target has moved on"
    return None
