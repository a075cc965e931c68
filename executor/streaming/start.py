"""The wait at the plan's start for the tick at which a plan to a target that moves begins."""

from __future__ import annotations

from executor.shared_memory import ANSWERED, OFFERED, PULSE, TAKEN
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


def await_start(
    connection: RtdeConnection, job: StreamJob, requests: StopRequests
) -> tuple[StreamJob, tuple[str, str] | None]:
    """Holds the arm until the tick before the first row's.

    Meanwhile the daemon may offer another job that begins where the arm stands, and waits for a tick of its own.

    Returns:
        The job to stream; outcome and reason of an early end, at rest, None where there is none.

    Raises:
        StreamFault: the connection failed.
    """
    due_s = first_row_s(job)
    if due_s is None:
        return job, None
    clock = ControllerClock(connection, job.dt)
    while clock.stamp < due_s - AHEAD * job.dt:
        job = _offered(connection, job, clock.stamp)
        due_s = first_row_s(job) or due_s
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
            return job, early
    late_s = clock.stamp - due_s
    if late_s > 0.5 * job.dt:
        reason = f"too late: the plan was to start {1e3 * late_s:.0f} ms ago, and its target has moved on"
        return job, ("refused", reason)
    return job, None


def _offered(connection: RtdeConnection, job: StreamJob, stamp: float) -> StreamJob:
    """Returns the job that the daemon offers in place of one that waits, if its first row can still be waited for."""
    fields = connection.memory.fields
    number = fields[OFFERED]
    if number == fields[ANSWERED]:
        return job
    offered = StreamJob.unpacked(connection.memory.offered())
    due_s = first_row_s(offered)
    if due_s is not None and stamp < due_s - AHEAD * offered.dt:
        job = offered
        fields[TAKEN] = number
    fields[ANSWERED] = number
    return job
