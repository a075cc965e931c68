"""The approach: to where the plan starts, by a straight joint move or along a planned way."""

from __future__ import annotations

from executor.board import PULSE, STATE, STOPPING, Board
from executor.job import Job
from executor.streaming.clock import Clock
from executor.streaming.link import Link
from executor.streaming.loop import Stream
from executor.streaming.orders import Orders

ARRIVED_RAD = 1e-3  # [rad] a controller ends its moves within 1e-4; an encoder resolves 1e-5
START_RAD = 0.01  # [rad] source: faults.md, C6
STANDS_RAD_S = 5e-3  # [rad/s] measured speed of an arm at rest, noise included
STANDS_TICKS = 10  # [ticks] in a row at rest at the goal
GRIP_S = 0.3  # [s] for the fingers to close; a two-finger gripper's stroke takes 0.2 to 0.6 s, and the approach follows
OUTPUT_SHIFT = {"standard_digital": 0, "configurable_digital": 8, "tool_digital": 16}  # source: RTDE guide, output bits
SLACK_S = 5.0  # [s] beyond twice the move's own duration


def approach(link: Link, job: Job, board: Board, orders: Orders, realtime: bool) -> tuple[str, str] | None:
    """Moves to the plan's start; returns outcome and reason where that ended early, at rest.

    Raises:
        LinkFault: the link failed.
    """
    if _close_gripper(link, job, board):
        return "aborted", "the gripper's output does not answer"
    if job.dry_run or arrived(link, job.start):
        return None
    if job.approach is not None:
        return _stream(link, job, board, orders, realtime)
    link.move(job.start)
    early = _follow(link, job.start, job, board, orders)
    if early is not None:
        board.words[STATE] = STOPPING  # the deceleration may take a second without a pulse
        link.stop_move()
    return early


def _stream(link: Link, job: Job, board: Board, orders: Orders, realtime: bool) -> tuple[str, str] | None:
    """Streams the planned way, like a plan; the plan's own stream then goes on where it has ended."""
    link.arm_watchdog(realtime)
    verdict = Stream(link, job.of_approach(), board, orders, recorded=False).run()
    if verdict[0] != "completed":
        return verdict
    if job.mode == "servoj":
        link.end_speeds()
    off = max([abs(a - b) for a, b in zip(link.q, job.start, strict=True)])
    return ("aborted", f"the approach ended {off:.3f} rad off the start") if off > START_RAD else None


def arrived(link: Link, goal: list[float]) -> bool:
    """Whether the arm stands at `goal` (6,) [rad]."""
    near = max([abs(a - b) for a, b in zip(link.q, goal, strict=True)]) < ARRIVED_RAD
    return near and max(map(abs, link.qd)) < STANDS_RAD_S


def _close_gripper(link: Link, job: Job, board: Board) -> bool:
    """Closes the gripper where it is open, while the arm stands; returns whether its output failed to follow."""
    bit = OUTPUT_SHIFT[job.output] + job.output_index
    if job.dry_run or job.output_row < 0 or bool(int(link.outputs) >> bit & 1) != job.output_level:
        return False
    link.output(not job.output_level)
    clock = Clock(link, job.dt)
    while clock.tick * job.dt < GRIP_S:
        clock.wait()
        link.read()
        link.check()
        board.words[PULSE] = clock.host_s
    return bool(int(link.outputs) >> bit & 1) == job.output_level


def _follow(link: Link, goal: list[float], job: Job, board: Board, orders: Orders) -> tuple[str, str] | None:
    clock = Clock(link, job.dt)
    way = max([abs(a - b) for a, b in zip(link.q, goal, strict=True)])
    expected = way / job.approach_speed + job.approach_speed / job.approach_acceleration
    standing = 0
    while standing < STANDS_TICKS:
        clock.wait()
        link.read()
        link.check()
        board.words[PULSE] = clock.host_s
        standing = standing + 1 if arrived(link, goal) else 0
        if (early := orders.stop()) is not None:
            return early
        if clock.tick * job.dt > 2.0 * expected + SLACK_S:
            return "aborted", "the approach did not arrive"
    return None
