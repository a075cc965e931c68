"""Entry of the streaming process: `python -m executor.streaming JOB_FD BOARD_FD PARENT_PID PULSE_THREAD`."""

from __future__ import annotations

import os
import sys
import traceback
from time import monotonic

from executor import board as words
from executor.board import Board
from executor.job import OUTCOMES, Job
from executor.streaming import realtime
from executor.streaming.approach import approach
from executor.streaming.fault import LinkFault
from executor.streaming.link import Link
from executor.streaming.loop import Stream
from executor.streaming.orders import Orders


def run(job: Job, board: Board, orders: Orders, alive: list[Link]) -> tuple[str, str]:
    """Runs one job from connecting to standing still; returns outcome and reason.

    The link is put into `alive`, so that no destructor of the library ever runs: each sleeps half a second.

    Raises:
        LinkFault: from the first anomaly on nothing was sent; the controller's watchdog and the daemon stop the arm.
    """
    refused = realtime.prepare(job.core, job.priority)
    board.words[words.REALTIME] = 0.0 if refused else 1.0
    link = Link(job, board)
    alive.append(link)
    realtime.step_down(job.priority)
    realtime.freeze_memory()
    link.check()
    board.words[words.STATE] = words.APPROACHING
    verdict = approach(link, job, board, orders, realtime=not refused)
    if verdict is None:
        link.arm_watchdog(realtime=not refused)
        board.words[words.STATE] = words.STREAMING
        verdict = Stream(link, job, board, orders).run()
    board.words[words.STATE] = words.STOPPING
    link.stop()
    return verdict


def main(job_fd: int, board_fd: int, parent: int, pulse: int) -> None:
    """Runs, writes the end on the board, and leaves at once, past every destructor of the library."""
    board = Board.attach(board_fd)
    job = Job.read(job_fd)
    alive: list[Link] = []
    state, code = words.FAULT, 1
    outcome, reason = "executor_lost", "the streaming process failed"
    try:
        orders = Orders(board, job.daemon_silent_s, parent, pulse)
        orders.listen()
        realtime.die_with_parent(parent)
        board.words[words.PULSE] = monotonic()
        outcome, reason = run(job, board, orders, alive)
        state, code = words.DONE, 0
    except LinkFault as fault:
        outcome, reason = fault.outcome, fault.reason
    except Exception:  # a bug of ours: the finally below leaves the arm to the watchdog and the daemon
        reason = traceback.format_exc(limit=-3)
    finally:
        board.write_text(reason)
        board.words[words.OUTCOME] = OUTCOMES.index(outcome)
        board.words[words.STATE] = state
        os._exit(code)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:5]))
