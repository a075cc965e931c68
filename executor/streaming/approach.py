"""The approach: from the present position to the plan's start, made as the plan is."""

from __future__ import annotations

from executor.shared_memory import PULSE
from executor.stream_job import StreamJob
from executor.streaming.clock import ControllerClock
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.script_stream import stream_of
from executor.streaming.state_checks import OUTPUT_SHIFT, StopRequests

START_RAD = 0.01  # [rad] accepted distance of the arm from where a motion begins: 1 cm at a reach of 1 m
SETTLE_S = 2.0  # [s] longest wait at the end of an approach for an arm that is later than the cell states
REPEAT_S = 0.05  # [s] after which an output that does not answer is told again: the package may be lost
GRIP_S = 0.3  # [s] for the fingers to close; a two-finger gripper's stroke takes 0.2 to 0.6 s, and the approach follows


def close_gripper(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Closes the gripper if it is open, while the arm stands; returns outcome and reason of an early end.

    Raises:
        StreamFault: the connection failed.
    """
    job = connection.job
    if job.dry_run or job.output_row < 0 or not _is_open(connection, job):
        return None
    clock = ControllerClock(connection, job.dt)
    told_s = -REPEAT_S
    while clock.tick * job.dt < GRIP_S:
        if _is_open(connection, job) and clock.tick * job.dt - told_s >= REPEAT_S:
            told_s = clock.tick * job.dt
            connection.output(not job.output_level)
        clock.wait()
        connection.read()
        connection.check()
        connection.memory.fields[PULSE] = clock.host_s
        if (early := requests.pending()) is not None:
            return early
    return ("aborted", "the gripper's output does not answer") if _is_open(connection, job) else None


def approach(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Moves to the plan's start, with the watchdog armed; returns outcome and reason where that ended early, at rest.

    Raises:
        StreamFault: the connection failed.
    """
    job = connection.job
    if job.dry_run:
        return None
    moved = _distance(connection.q, job.q[0] if job.approach is None else job.approach.q[0])
    if moved > START_RAD:
        return "refused", f"the arm was moved by {moved:.3f} rad while its way to the start was planned"
    if job.approach is None:
        return None
    verdict = stream_of(connection, job.approach_job(), requests, recorded=False, settle_s=SETTLE_S).run()
    if verdict[0] != "completed":
        return verdict
    if job.mode == "servoj":
        connection.end_speeds()
    off = _distance(connection.q, job.q[0])
    return ("aborted", f"the approach ended {off:.3f} rad off the start") if off > START_RAD else None


def _is_open(connection: RtdeConnection, job: StreamJob) -> bool:
    bit = OUTPUT_SHIFT[job.output] + job.output_index
    return bool(int(connection.outputs) >> bit & 1) == job.output_level


def _distance(a: list[float], b: list[float]) -> float:
    """Returns the largest difference of two joint positions [rad]."""
    return max([abs(x - y) for x, y in zip(a, b, strict=True)])
