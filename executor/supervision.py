"""Supervision: one streaming process, watched, and made to stop whatever becomes of it.

A thread of its own, so that a slow database never delays the pulse. Whatever ends the process in any other way than
at rest and in order, the controller is told to stop over a line of our own, and the process is killed and reaped.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from executor import awake
from executor import board as words
from executor.board import Board
from executor.child import Child
from executor.dashboard import Dashboard
from executor.job import OUTCOMES, Job

PERIOD_S = 0.005  # [s] of the pulse
SPARE_ROWS = 1000  # room for a brake that is longer than what is left of the plan
LIMIT_S = {  # longest silence in each state [s]
    words.STARTING: 15.0,  # a refused program takes the library 5 s, a silent dashboard 2.5 s (rtde.md, section 10)
    words.CONNECTED: 1.0,
    words.APPROACHING: 0.25,
    words.STREAMING: 0.1,  # the process itself gives up after 40 ms; the controller's watchdog after 50
    words.BRAKING: 0.1,
    words.STOPPING: 5.0,  # speedStop and stopScript wait for the controller
    words.DONE: 1.0,
    words.FAULT: 1.0,
}


@dataclass(frozen=True, eq=False)
class RunResult:
    """How a run ended.

    Attributes:
        outcome: of the contract.
        reason: for a person.
        rows: telemetry (n, columns), see executor.board.
        missed: ticks missed.
        realtime: whether the machine granted everything.
        output_sent_s: plan's clock when the gripper was told [s]; None where it was not.
        output_late_s: how much later than planned.
        timestamp_at_zero: the controller's time at the plan's clock 0 [s].
        in_order: whether the process itself brought the arm to rest.
    """

    outcome: str
    reason: str
    rows: NDArray[np.float64]
    missed: int
    realtime: bool
    output_sent_s: float | None
    output_late_s: float
    timestamp_at_zero: float
    in_order: bool


class Run:
    """One streaming process."""

    def __init__(self, job: Job, host: str, log: Path) -> None:
        """Prepares a run; what the library says goes into the file `log`."""
        self.log = log
        self.board = Board.create(len(job.q) + SPARE_ROWS)
        self.board.words[words.OUTPUT_SENT_S] = np.nan
        self.dashboard = Dashboard(host)
        self.job = job
        self.result: RunResult | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name="supervision", daemon=True)
        self._child: Child | None = None
        self._failed_by_itself = False

    @property
    def state(self) -> int:
        """What the process is doing, see executor.board."""
        return int(self.board.words[words.STATE])

    @property
    def row_count(self) -> int:
        """Rows of telemetry so far."""
        return int(self.board.words[words.ROWS])

    def start(self) -> None:
        """Starts the process and the thread that watches it."""
        self._thread.start()

    def abort(self) -> None:
        """Asks for the brake; asking twice changes nothing."""
        self.board.words[words.ABORT] = 1.0

    def wait(self, timeout_s: float) -> bool:
        """Waits for the end; returns whether it came."""
        return self._ended.wait(timeout_s)

    def latest_row(self) -> NDArray[np.float64] | None:
        """Returns the newest row of telemetry."""
        count = min(self.row_count, self.board.capacity)
        return np.frombuffer(self.board.row_bytes(count - 1)) if count else None

    def _supervise(self) -> None:
        try:
            with awake.kept(self.job.core):
                self._run()
        finally:
            self._ended.set()

    def _run(self) -> None:
        failure = "the supervision failed"
        try:
            failure = f"the dashboard at {self.dashboard.host}"
            self.dashboard.connect()
            failure = "starting the streaming process"
            self._spawn()
            failure = self._watch()
        except OSError as error:
            failure = f"{failure}: {error}"
        finally:
            self._make_safe(failure)
            self.result = self._result(failure)

    def _spawn(self) -> None:
        job_fd = self.job.write()
        self.board.words[words.DAEMON_PULSE] = self.board.words[words.PULSE] = time.monotonic()
        pulse = threading.get_native_id()  # this thread gives the pulse: frozen, it can be seen to be
        command = [sys.executable, "-m", "executor.streaming", *map(str, (job_fd, self.board.fd, os.getpid(), pulse))]
        self._child = Child(command, (job_fd, self.board.fd), self.log)
        os.close(job_fd)

    def _watch(self) -> str:
        """Returns when the process ended, hangs or is frozen; the text says how, empty where all is in order."""
        child, board = self._child, self.board
        assert child is not None
        since, state = time.monotonic(), words.STARTING
        while not child.ends_within(PERIOD_S):
            now = time.monotonic()
            board.words[words.DAEMON_PULSE] = now
            if self.state != state:
                since, state = now, self.state
            if state == words.FAULT:
                return "fault"
            if child.is_frozen():
                return "the streaming process was frozen"
            silent = now - max(since, board.words[words.PULSE])
            if silent > LIMIT_S[state]:
                self._failed_by_itself = True
                return f"the streaming process was silent for {silent * 1e3:.0f} ms"
        if self.state == words.DONE:
            return ""
        if self.state == words.FAULT:
            return "fault"
        self._failed_by_itself = not child.ended_from_outside
        return ": ".join([f"the streaming process ended with {child.code}", *child.last_words()])

    def _make_safe(self, failure: str) -> None:
        """Kills what hangs and stops the program on the controller, unless the run ended in order."""
        child = self._child
        if child is not None:
            if failure:
                child.kill()  # first: what hangs in the library may wake and upload the program anew
                with contextlib.suppress(OSError):  # then only the controller's own watchdog is left, and it is armed
                    self.dashboard.ask("stop")
            child.reap()
        self.dashboard.close()

    def _silent_outcome(self) -> str:
        """Returns the outcome of a process that ended without a word; failing in the library it was the link."""
        if self._child is None:
            return "refused"
        in_library = self.board.words[words.IN_CALL] and self._failed_by_itself
        return "link_lost" if in_library else "executor_lost"

    def _result(self, failure: str) -> RunResult:
        board = self.board
        known = self.state in (words.DONE, words.FAULT)
        sent = float(board.words[words.OUTPUT_SENT_S])
        return RunResult(
            outcome=OUTCOMES[int(board.words[words.OUTCOME])] if known else self._silent_outcome(),
            reason=board.text() if known else failure,
            rows=np.frombuffer(board.row_bytes()).reshape(-1, words.ROW.size // 8),
            missed=int(board.words[words.MISSED]),
            realtime=bool(board.words[words.REALTIME]),
            output_sent_s=None if np.isnan(sent) else sent,
            output_late_s=float(board.words[words.OUTPUT_LATE_S]),
            timestamp_at_zero=float(board.words[words.TIMESTAMP_AT_ZERO]),
            in_order=not failure,
        )
