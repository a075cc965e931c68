"""The streaming process as its executor sees it: one that waits for the next execution, and one that was left behind.

A process takes a tenth of a second to start and to load. So one is started before it is needed, and waits at a socket
of its own for its order. It knows nothing of the cell and has no connection to the robot: what it is to do, and the
memory in which it tells how that goes, are descriptors that come with the order. It ends with its executor, twice over:
by the kernel's signal, and because its socket ends.
"""

from __future__ import annotations

import fcntl
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from executor import realtime
from executor.logs import log as log_line
from executor.stream_order import StreamOrder

POLL_S = 0.005  # [s] between two looks at a process that is to end
ORPHAN_S = (
    2.0  # [s] for the stream of an executor that has died to brake and end: it brakes in 0.2 s, and waits 1 s for rest
)
EXTERNAL_SIGNALS = (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)  # return codes that no library causes
STREAM_MODULE = "executor.streaming"
LOCK = struct.Struct("hhqqi4x")  # source: fcntl(2), struct flock on 64-bit Linux: type, whence, start, length, process
STREAM_LOG = "streaming.log"  # output of the streaming process of the newest execution
SPARE_LOG = "streaming-next.log"  # of the one that waits for the next


class ChildProcess(subprocess.Popen[bytes]):
    """A child process whose end is noticed at once, and whose freezing (SIGSTOP) can be seen."""

    def __init__(self, command: Sequence[str], descriptors: Sequence[int], log: Path) -> None:
        """Starts `command` with `descriptors` inherited and its output in the file `log`.

        Raises:
            OSError: it cannot be started.
        """
        self.log = log
        with log.open("wb") as stream:  # a file: a pipe that nobody reads would block the child one day
            super().__init__(command, pass_fds=descriptors, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream)
        try:
            self._descriptor = os.pidfd_open(self.pid)
        except OSError:  # a kernel before 5.3: without a notice of its end, the child must not run
            self.kill()
            self.wait()
            raise
        self._end = select.poll()
        self._end.register(self._descriptor, select.POLLIN)

    @property
    def was_killed(self) -> bool:
        """Whether it was ended by a signal that no library raises."""
        return self.poll() in EXTERNAL_SIGNALS

    def ends_within(self, duration_s: float) -> bool:
        """Waits for its end up to `duration_s` [s]; returns whether it came."""
        return bool(self._end.poll(1e3 * duration_s))

    def is_frozen(self) -> bool:
        """Whether a signal has stopped it (SIGSTOP)."""
        try:
            return os.waitid(os.P_PID, self.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
        except ChildProcessError:
            return False  # ended and reaped

    def last_line(self) -> list[str]:
        """Returns the last line of its output; empty without output."""
        return self.log.read_text(errors="replace").strip().splitlines()[-1:]

    def reap(self) -> None:
        """Waits for its end and releases its resources."""
        self.wait()
        os.close(self._descriptor)


def end_orphan(log: Path) -> int | None:
    """Ends the streaming process that an executor left which has died; returns its number, None without one.

    A frozen one (SIGSTOP) does not take the SIGTERM that comes with its executor's death. It would keep the
    controller's inputs, so that every further run is refused, and finish the tick in which it was frozen once somebody
    wakes it. Each locks its log for as long as it lives.

    Args:
        log: file for its output.
    """
    end = time.monotonic() + ORPHAN_S
    while (process := _locked_by(log)) is not None and time.monotonic() < end:
        time.sleep(POLL_S)
    if process is None:
        return None
    with suppress(OSError):  # gone meanwhile, or somebody else's
        descriptor = os.pidfd_open(process)  # from here on this number is no other process
        try:
            if not _is_stream(process):
                return None
            signal.pidfd_send_signal(descriptor, signal.SIGKILL)
            select.select([descriptor], [], [], ORPHAN_S)
        finally:
            os.close(descriptor)
        return process
    return None


def _is_stream(process: int) -> bool:
    """Returns whether a process is a streaming process of this program."""
    try:
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return STREAM_MODULE.encode() in words


def _locked_by(file: Path) -> int | None:
    """Returns the number of the process that holds the lock of a file; None without one."""
    try:
        with file.open("rb") as stream:
            found = fcntl.fcntl(stream, fcntl.F_GETLK, LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    except OSError:  # there was no run yet
        return None
    kind, _, _, _, process = LOCK.unpack(found)
    # 0 and below are no process that can be signalled: the holder is in another container, or on another machine.
    return None if kind == fcntl.F_UNLCK or process <= 1 else process


class StreamProcess(ChildProcess):
    """A streaming process, which waits for its order."""

    def __init__(self, log: Path) -> None:
        """Starts it, with its output in the file `log`.

        Raises:
            OSError: it cannot be started.
        """
        self._channel, theirs = socket.socketpair()
        try:
            command = [sys.executable, "-P", "-m", STREAM_MODULE, str(theirs.fileno()), str(os.getpid())]
            super().__init__(command, (theirs.fileno(),), log)
        except OSError:
            self._channel.close()
            raise
        finally:
            theirs.close()

    def order(self, order: StreamOrder) -> None:
        """Gives it its order, and this thread's real-time priority until it takes its own.

        One that has ended does not take it, and its end is seen all the same.
        """
        if realtime.is_real_time():
            with suppress(OSError):
                os.sched_setscheduler(self.pid, os.SCHED_FIFO, os.sched_param(realtime.DAEMON_PRIORITY))
        with suppress(BrokenPipeError, ConnectionResetError):
            order.send(self._channel)

    def reap(self) -> None:
        """Waits for its end and releases its resources."""
        self._channel.close()
        super().reap()


class SpareStream:
    """The streaming process for the next execution, started beforehand where there is time for that."""

    def __init__(self, folder: Path) -> None:
        """Prepares it; the output of its processes goes to `folder`."""
        self._folder = folder
        self._waiting: StreamProcess | None = None

    @property
    def logs(self) -> tuple[Path, Path]:
        """Files for the output of the process of the newest execution, and of the one that waits."""
        return self._folder / STREAM_LOG, self._folder / SPARE_LOG

    def prepare(self) -> None:
        """Starts a process that waits, unless one does; without one the next execution starts its own.

        Call it from a thread that lives as long as this process: the kernel ends a child with the thread that made it.
        """
        if self._is_fit():
            return
        self.close()
        try:
            self._waiting = StreamProcess(self._folder / SPARE_LOG)
        except OSError as error:
            log_line("no streaming process could be started for the next execution", error=repr(error))

    def take(self) -> StreamProcess:
        """Returns a process that waits, or a new one; its output is in the log of the newest execution from now on.

        Raises:
            OSError: it cannot be started.
        """
        log = self._folder / STREAM_LOG
        if not self._is_fit():
            self.close()
            return StreamProcess(log)
        assert self._waiting is not None
        taken = self._waiting
        try:
            os.replace(taken.log, log)
        except OSError:  # somebody deleted it: what this process says would be lost
            self.close()
            return StreamProcess(log)
        taken.log = log
        self._waiting = None
        return taken

    def close(self) -> None:
        """Ends the process that waits."""
        if self._waiting is not None:
            self._waiting.kill()
            self._waiting.reap()
            self._waiting = None

    def _is_fit(self) -> bool:
        """Whether a process waits; none that has ended, or was frozen."""
        waiting = self._waiting
        return waiting is not None and not waiting.ends_within(0.0) and not waiting.is_frozen()
