"""Supervision of the streaming process, from a thread of its own that stops it whatever happens.

A separate thread, so that a slow database never delays the pulse. Unless the process ends at rest and in order, it is
killed and reaped, and the controller's program is ended: over the primary interface, which every controller has, and
over the dashboard where there is one.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import threading
import time

import numpy as np
from numpy.typing import NDArray

from executor import realtime
from executor import shared_memory as shm
from executor.grippers import GripperConnection
from executor.records import RunResult
from executor.robot import DashboardClient, GripperHold, ProgramWatch, set_outputs
from executor.shared_memory import SharedMemory
from executor.stream_job import OUTCOMES, StreamJob
from executor.stream_order import StreamOrder
from executor.stream_process import SpareStream, StreamProcess
from planner.controller_program import SwitchRow

PERIOD_S = 0.005  # [s] of the pulse
SPARE_ROWS = 1000  # room for a brake that is longer than the rest of the plan
REPLACED_ROWS = 10_000  # room for plans that replace the running one
ANSWER_S = 0.001  # [s] between two looks whether an offer was answered
LIMIT_S = {  # longest silence in each state [s]
    shm.STARTING: 15.0,  # a refused program takes the library 5 s, a silent dashboard 2.5 s (ur_rtde 1.6.5)
    shm.APPROACHING: 0.1,
    shm.STREAMING: 0.1,  # the process gives up after 40 ms, the controller's watchdog after 20 (50 without real time)
    shm.BRAKING: 0.1,
    shm.STOPPING: 5.0,  # speedStop and stopScript wait for the controller
    shm.DONE: 1.0,
    shm.FAULT: 1.0,
}
FOREIGN_WAIT_S = 0.35  # [s] messages come ten times a second; some more for a program that begins only now
EXPLAINED_BY_FOREIGN = ("aborted", "tracking", "late", "link_lost")  # what another program looks like to the stream
# Return codes that only the library causes: ur_rtde 1.6.5 crashes as it reconnects to a controller without dashboard.
CRASHES = (-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGBUS)
HELD = {shm.GRIP_HELD: True, shm.GRIP_EMPTY: False, shm.GRIP_REOPENED: False}
HUNG = -signal.SIGALRM  # return code of a stream that hung in the library: `executor.streaming.rtde_connection`


class StreamRun:
    """One run of the streaming process. `result` is set when it has ended."""

    def __init__(
        self, job: StreamJob, spare: SpareStream, keep_awake: bool = True, gripper: GripperConnection | None = None
    ) -> None:
        """Prepares a run.

        Args:
            job: what to stream.
            spare: whose process it takes.
            keep_awake: keep the stream's processor from sleeping meanwhile.
            gripper: connection that the process is given; None: outputs switch the gripper.
        """
        self._jobs = [job]
        self._places = [shm.PLACES - 1]  # of each job in the memory; of the first it does not matter
        self.memory = SharedMemory.create(len(job.q) + SPARE_ROWS + REPLACED_ROWS)
        for field in (shm.OUTPUT_SENT_S, shm.OUTPUT_CLOSED_S, shm.SHUT_AT_S, shm.MOVED_BY_S, shm.STOPPED_S):
            self.memory.fields[field] = np.nan
        self.dashboard = DashboardClient(job.host)
        self.programs = ProgramWatch(job.host)
        self.outputs = GripperHold(job.host)
        self.gripper = gripper
        self.held_at_s: float | None = None  # plan time
        self.stop_levels: list[SwitchRow] = []
        self.stopped_s = math.nan  # plan time
        self.left: list[SwitchRow] = []  # outputs that were not seen to take the level that a stop gave them
        self.result: RunResult | None = None
        self._awake_core = job.core if keep_awake else realtime.ANY_CORE
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name="supervision", daemon=True)
        self._spare = spare
        self._child: StreamProcess | None = None
        self._failed_by_itself = False
        self._abort_reason = ""

    @property
    def taken(self) -> int:
        """Number of the job that the process goes by: 0 for its first, then in the order in which they were offered."""
        return int(self.memory.fields[shm.TAKEN])

    @property
    def job(self) -> StreamJob:
        """The job that the process goes by."""
        return self._jobs[self.taken]

    @property
    def state(self) -> int:
        """State of the process; see `executor.shared_memory`."""
        return int(self.memory.fields[shm.STATE])

    @property
    def furthest(self) -> int:
        """The last of `APPROACHING` and `STREAMING` that the process entered; 0 before."""
        return int(self.memory.fields[shm.FURTHEST])

    @property
    def row_count(self) -> int:
        """Number of telemetry rows so far."""
        return int(self.memory.fields[shm.ROWS])

    def start(self) -> None:
        """Starts the thread that gives the process its order, and supervises it."""
        self._thread.start()

    def abort(self, reason: str = "") -> None:
        """Requests the brake, for a reason other than a client's request; repeated requests have no effect."""
        self._abort_reason = self._abort_reason or reason
        self.memory.fields[shm.ABORT] = 1.0

    def has_room(self, packed: bytes) -> bool:
        """Returns whether the memory holds the telemetry of a job that is to be offered."""
        return len(StreamJob.unpacked(memoryview(packed)).q) + SPARE_ROWS <= self.memory.capacity

    def offer(self, packed: bytes) -> bool:
        """Offers a job that replaces the running one from its `joins_row` on; returns whether the process goes by it.

        The process answers at its next tick.
        """
        number = len(self._jobs)
        place = (self._places[self.taken] + 1) % shm.PLACES
        self._jobs.append(StreamJob.unpacked(memoryview(packed)))
        self._places.append(place)
        self.memory.offer(packed, place)
        while self.memory.fields[shm.ANSWERED] < number and not self._ended.wait(ANSWER_S):
            pass
        return self.taken == number

    def present_row(self) -> int:
        """Returns the row that is sent about now; -1 before the first."""
        latest = self.latest_row()
        job = self.job
        return -1 if latest is None else round((_clock_s(latest) - job.first_clock_s) / job.dt + job.lag_ticks)

    def wait(self, timeout_s: float) -> bool:
        """Waits for the end; returns whether it came."""
        return self._ended.wait(timeout_s)

    def latest_row(self) -> NDArray[np.float64] | None:
        """Returns the newest row of telemetry; None without one."""
        count = min(self.row_count, self.memory.capacity)
        rows = self.memory.row_bytes(count - 1) if count else b""
        return np.frombuffer(rows[: shm.ROW.size]) if rows else None

    def _supervise(self) -> None:
        try:
            with realtime.keep_awake(self._awake_core):
                self._run()
        finally:
            self.programs.close()
            self.memory.close()
            self._ended.set()

    def _run(self) -> None:
        failure = "the supervision failed"
        try:
            failure = f"no way to stop the controller at {self.job.host}"
            self._connect()
            failure = "starting the streaming process"
            self._spawn()
            failure = self._watch()
        except OSError as error:
            failure = f"{failure}: {error}"
        finally:
            self._make_safe(failure)
            self.result = self._result(failure)

    def _connect(self) -> None:
        """Opens the ways to stop the controller's program and to keep the object, so that one packet is enough.

        Raises:
            OSError: neither primary interface nor dashboard answers.
        """
        self.programs.connect()
        self.outputs.connect()
        try:
            self.dashboard.connect()
        except OSError:
            if not self.programs.is_connected:
                raise

    def _spawn(self) -> None:
        job_fd = self.job.write()
        memory = self.memory
        memory.fields[shm.DAEMON_PULSE] = memory.fields[shm.PULSE] = time.monotonic()
        pulse = threading.get_native_id()  # this thread writes the pulse: the child checks whether it is frozen
        gripper_fd = -1 if self.gripper is None else self.gripper.fileno()
        try:
            self._child = self._spare.take()
            self._child.order(StreamOrder(job_fd, memory.fd, gripper_fd, pulse))
        finally:
            os.close(job_fd)

    def _watch(self) -> str:
        """Returns a reason once the process has ended, hangs or is frozen; empty if it ended in order."""
        child = self._child
        fields = self.memory.fields
        assert child is not None
        since = time.monotonic()
        state = shm.STARTING
        while not child.ends_within(PERIOD_S):
            now = time.monotonic()
            fields[shm.DAEMON_PULSE] = now
            self.programs.poll()
            self.outputs.drain()
            if self.state != state:
                since = now
                state = self.state
            if state == shm.FAULT:
                return "fault"
            if child.is_frozen():
                return "the streaming process was frozen"
            silent = now - max(since, fields[shm.PULSE])
            if silent > LIMIT_S[state]:
                self._failed_by_itself = True
                return f"the streaming process was silent for {silent * 1e3:.0f} ms"
        if self.state == shm.DONE:
            return ""
        if self.state == shm.FAULT:
            return "fault"
        self._failed_by_itself = not child.was_killed
        code = child.poll()
        how = f"ur_rtde crashed ({code})" if code in CRASHES else f"the streaming process ended with {code}"
        how = "ur_rtde hung in a call" if code == HUNG else how
        return ": ".join([how, *child.last_line()])

    def _make_safe(self, failure: str) -> None:
        """Kills the process and stops the controller's program, unless the run ended in order."""
        child = self._child
        if child is not None:
            if failure:
                child.kill()  # first: a call that hangs in the library may resume and upload the program again
                if not self.job.dry_run:  # which has started nothing
                    self._stop_controller()
            child.reap()
            self._end_switching(bool(failure))
        self.dashboard.close()
        self.outputs.close()
        if self.gripper is not None:
            self.gripper.close()

    def _stop_controller(self) -> None:
        """Ends the controller's program, and closes the gripper where it may still hold the object."""
        was_held = self._hold_object()
        self.programs.stop()
        if was_held and self.job.program:
            self.outputs.hold(self.job)  # once more: the program may have opened it before it was stopped
        with contextlib.suppress(OSError):  # it has none, or the controller's own watchdog is left, and armed
            self.dashboard.ask("stop")

    def _hold_object(self) -> bool:
        """Closes the gripper again while it still holds the object: the arm stops, and would drop it.

        Returns whether an output was told to.

        A program in the controller may have opened it since the newest state.
        """
        job = self.job
        row = self.latest_row()
        may_be_open = not np.isnan(self.memory.fields[shm.OUTPUT_SENT_S]) or (job.program and job.output_row >= 0)
        if row is None or not may_be_open:
            return False
        if _clock_s(row) >= job.first_clock_s + job.release_row * job.dt:
            self.outputs.end_blowing(job)
            return False
        if self.gripper is None:
            return self.outputs.hold(job)
        if self.gripper.hold():
            self.held_at_s = _clock_s(row)
        return False

    def _end_switching(self, stopped: bool) -> None:
        """Gives outputs that were switched their last levels, after a stop that was no orderly brake.

        A program in the controller may have gone on by some rows after those that it was seen to make.
        """
        job = self.job
        if job.dry_run:
            return
        sent = int(np.count_nonzero(~np.isnan(self.memory.switched[: len(job.switches)])))
        row = self.latest_row()
        reached = -1
        if stopped and job.program and row is not None:
            reached = math.ceil((_clock_s(row) - job.first_clock_s) / job.dt + job.lag_ticks)
        self.stop_levels = job.stop_levels(sent, reached, self._stop_row(stopped))
        if stopped and self.stop_levels:
            self.left = set_outputs(job.host, self.stop_levels)
            self.stopped_s = math.nan if row is None else _clock_s(row)

    def _stop_row(self, stopped: bool) -> float:
        """Returns the row with which a stop began: that of the brake, or the present one; infinite without a stop."""
        job = self.job
        at_s = float(self.memory.fields[shm.STOPPED_S])
        row = self.latest_row()
        if math.isnan(at_s) and stopped and row is not None:
            at_s = _clock_s(row)
        return math.inf if math.isnan(at_s) else (at_s - job.first_clock_s) / job.dt + job.lag_ticks

    def _silent_outcome(self) -> str:
        """Returns the outcome of a process that reported none; where it failed in the library, the link failed."""
        if self._child is None:
            return "refused"
        in_library = self.memory.fields[shm.IN_CALL] and self._failed_by_itself
        return "link_lost" if in_library or self._child.poll() in CRASHES else "executor_lost"

    def _result(self, failure: str) -> RunResult:
        fields = self.memory.fields
        memory = self.memory
        outcome, reason = self._verdict(failure)
        sent = float(fields[shm.OUTPUT_SENT_S])
        closed = float(fields[shm.OUTPUT_CLOSED_S])
        stopped_s = float(fields[shm.STOPPED_S])
        for each in self.left:
            reason = f"{reason}; {each.output} {each.index} was not seen to switch {'on' if each.level else 'off'}"
        return RunResult(
            outcome=outcome,
            reason=reason,
            rows=np.frombuffer(memory.row_bytes()).reshape(-1, shm.ROW.size // 8),
            missed=int(fields[shm.MISSED]),
            realtime=bool(fields[shm.REALTIME]),
            output_sent_s=None if np.isnan(sent) else sent,
            output_late_s=float(fields[shm.OUTPUT_LATE_S]),
            stayed_closed=bool(fields[shm.STAYED_CLOSED]),
            grip_held=HELD.get(int(fields[shm.GRIP])),
            opened_again=int(fields[shm.GRIP]) == shm.GRIP_REOPENED,
            moved_between=(float(fields[shm.SHUT_AT_S]), float(fields[shm.MOVED_BY_S])),
            output_closed_s=self.held_at_s if np.isnan(closed) else closed,
            timestamp_at_zero=float(fields[shm.TIMESTAMP_AT_ZERO]),
            in_order=not failure,
            switched_s=tuple(memory.switched[: len(self.job.switches)]),
            stop_levels=[each for each in self.stop_levels if each not in self.left],
            stopped_s=self.stopped_s if math.isnan(stopped_s) else stopped_s,
            ready_at_s=float(fields[shm.READY_AT_S]) or None,
        )

    def _verdict(self, failure: str) -> tuple[str, str]:
        """Returns outcome and reason; where another client's program took over, that is what happened."""
        reported = self.state in (shm.DONE, shm.FAULT)
        outcome = OUTCOMES[int(self.memory.fields[shm.OUTCOME])] if reported else self._silent_outcome()
        reason = self.memory.text() if reported else failure
        reason = self._abort_reason or reason if outcome == "aborted" else reason
        foreign = ""
        if failure and outcome in EXPLAINED_BY_FOREIGN:
            foreign = self.programs.wait(FOREIGN_WAIT_S)
        self.programs.close()
        return ("foreign_program", f"another client's script took over: {foreign}") if foreign else (outcome, reason)


def _clock_s(row: NDArray[np.float64]) -> float:
    """Returns the present plan time, by a row of telemetry [s]."""
    return float(row[shm.SCALARS.index("clock_s")] + time.monotonic() - row[shm.SCALARS.index("host_s")])
