"""The approach: from the present position to the plan's start, by a straight joint move or a planned motion."""

from __future__ import annotations

from executor.shared_memory import PULSE, STATE, STOPPING
from executor.stream_job import StreamJob
from executor.streaming.clock import ControllerClock
from executor.streaming.loop import Stream
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.state_checks import OUTPUT_SHIFT, StopRequests

ARRIVED_RAD = 1e-3  # [rad] a controller ends its moves within 1e-4; an encoder resolves 1e-5
START_RAD = 0.01  # [rad] accepted distance of a planned approach's end from the plan's start: 1 cm at a reach of 1 m
STANDS_RAD_S = 5e-3  # [rad/s] measured speed of an arm at rest, noise included
STANDS_TICKS = 10  # [ticks] in a row at rest at the goal
GRIP_S = 0.3  # [s] for the fingers to close; a two-finger gripper's stroke takes 0.2 to 0.6 s, and the approach follows

SLACK_S = 5.0  # [s] beyond twice the nominal duration of a move


def approach(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Moves to the plan's start; returns outcome and reason where that ended early, at rest.

    Raises:
        StreamFault: the connection failed.
    """
    job = connection.job
    early = _close_gripper(connection, requests)
    if early is not None:
        return early
    if job.dry_run or has_arrived(connection, job.start):
        return None
    if job.approach is not None:
        return _stream(connection, requests)
    connection.move(job.start)
    early = _follow(connection, requests)
    if early is not None:
        connection.memory.fields[STATE] = STOPPING  # the deceleration may take a second without a pulse
        connection.stop_move()
    return early


def _stream(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Streams the planned approach as a plan is streamed."""
    job = connection.job
    connection.arm_watchdog()
    verdict = Stream(connection, job.approach_job(), requests, recorded=False).run()
    if verdict[0] != "completed":
        return verdict
    if job.mode == "servoj":
        connection.end_speeds()
    off = _distance(connection.q, job.start)
    return ("aborted", f"the approach ended {off:.3f} rad off the start") if off > START_RAD else None


def has_arrived(connection: RtdeConnection, goal: list[float]) -> bool:
    """Whether the arm stands at `goal` (6,) [rad]."""
    return _distance(connection.q, goal) < ARRIVED_RAD and max(map(abs, connection.qd)) < STANDS_RAD_S


def _close_gripper(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Closes the gripper if it is open, while the arm stands; returns outcome and reason of an early end."""
    job = connection.job
    if job.dry_run or job.output_row < 0 or not _is_open(connection, job):
        return None
    connection.output(not job.output_level)
    clock = ControllerClock(connection, job.dt)
    while clock.tick * job.dt < GRIP_S:
        _tick(connection, clock)
        if (early := requests.pending()) is not None:
            return early
    return ("aborted", "the gripper's output does not answer") if _is_open(connection, job) else None


def _follow(connection: RtdeConnection, requests: StopRequests) -> tuple[str, str] | None:
    """Waits until a joint move has arrived; returns outcome and reason where it must end early."""
    job = connection.job
    clock = ControllerClock(connection, job.dt)
    distance = _distance(connection.q, job.start)
    nominal_s = distance / job.approach_speed + job.approach_speed / job.approach_acceleration
    standing = 0
    while standing < STANDS_TICKS:
        _tick(connection, clock)
        # A slow move has arrived before it ends, and the controller ends a program that commands two at a time.
        ended = has_arrived(connection, job.start) and not any(connection.target_qd)
        standing = standing + 1 if ended else 0
        if (early := requests.pending()) is not None:
            return early
        if clock.tick * job.dt > 2.0 * nominal_s + SLACK_S:
            return "aborted", "the approach did not arrive"
    return None


def _tick(connection: RtdeConnection, clock: ControllerClock) -> None:
    """Waits for the next tick, reads and checks its state, and writes the pulse."""
    clock.wait()
    connection.read()
    connection.check()
    connection.memory.fields[PULSE] = clock.host_s


def _is_open(connection: RtdeConnection, job: StreamJob) -> bool:
    bit = OUTPUT_SHIFT[job.output] + job.output_index
    return bool(int(connection.outputs) >> bit & 1) == job.output_level


def _distance(a: list[float], b: list[float]) -> float:
    """Returns the largest difference of two joint positions [rad]."""
    return max([abs(x - y) for x, y in zip(a, b, strict=True)])
