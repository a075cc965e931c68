"""The approach: from the present position to the plan's start, made as the plan is."""

from __future__ import annotations

from executor.shared_memory import GRIP, GRIP_EMPTY, GRIP_HELD, GRIP_REOPENED, PULSE
from executor.streaming.clock import ControllerClock
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.script_stream import stream_of
from executor.streaming.state_checks import StopRequests

START_RAD = 0.01  # [rad] accepted distance of the arm from where a motion begins: 1 cm at a reach of 1 m
SETTLE_S = 2.0  # [s] longest wait at the end of an approach for an arm that is later than the cell states
REPEAT_S = 0.05  # [s] after which an output that does not answer is told again: the package may be lost


def take_object(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Closes a gripper that is not seen closed, and checks that it holds an object, while the arm stands.

    Only where that can be seen. A gripper that has closed on nothing is opened again, as it was before. One that is
    open and has an object all the same, as its input shows, did not let the last one go.

    Returns:
        Outcome and reason of an early end; None where there is none.

    Raises:
        StreamFault: the connection failed.
    """
    job = connection.job
    gripper = connection.gripper
    if job.dry_run or job.output_row < 0:
        return None
    if gripper.is_open() and job.grip_input is not None and gripper.holds():
        return "refused", f"the gripper still holds an object: input {job.grip_input} is high"
    closes = gripper.is_open() is not False
    if closes and (early := _close(connection, requests)) is not None:
        return early
    holds = gripper.holds()
    if holds is None:
        return None
    empty = GRIP_REOPENED if closes else GRIP_EMPTY
    connection.memory.fields[GRIP] = GRIP_HELD if holds else empty
    if holds:
        return None
    if closes:
        gripper.tell(True)
    what = "the gripper closed on nothing" if closes else "the gripper is closed and holds nothing"
    return "refused", f"{what}: {gripper.not_holding()}"


def _close(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Closes the gripper; returns outcome and reason of an early end.

    It is waited for until it reports that it is closed, or has an object where it can tell.
    """
    job = connection.job
    gripper = connection.gripper
    gripper.tell(False)
    clock = ControllerClock(connection, job.dt)
    told_s = 0.0
    while clock.tick * job.dt < job.close_s and not (gripper.is_closed() and gripper.holds() is not False):
        if job.link is None and gripper.is_open() and clock.tick * job.dt - told_s >= REPEAT_S:
            told_s = clock.tick * job.dt
            gripper.tell(False)
        clock.wait()
        connection.read()
        connection.check()
        gripper.cycle()
        connection.memory.fields[PULSE] = clock.host_s
        if (early := requests.pending()) is not None:
            return early
        if (found := gripper.problem()) is not None:
            return "aborted", found[1]
    return ("aborted", gripper.stays_open) if gripper.is_open() else None


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
    if job.mode == "servoj":
        connection.end_speeds()
    if verdict[0] != "completed":
        return verdict
    off = _distance(connection.q, job.q[0])
    return ("aborted", f"the approach ended {off:.3f} rad off the start") if off > START_RAD else None


def _distance(a: list[float], b: list[float]) -> float:
    """Returns the largest difference of two joint positions [rad]."""
    return max([abs(x - y) for x, y in zip(a, b, strict=True)])
