"""What the stream tells its gripper through: digital outputs, or a connection that was open before the run.

Nothing here waits: one package to the controller, or one small write to a socket that does not block.
"""

from __future__ import annotations

import socket
from math import isnan, nan
from time import monotonic, sleep
from typing import TYPE_CHECKING, Protocol

from executor import shared_memory as shm
from executor.grippers import driver_of
from executor.stream_job import StreamJob
from executor.streaming.state_checks import OUTPUT_SHIFT
from executor.undelivered import close_in_order, discard_at_close

if TYPE_CHECKING:
    from executor.streaming.rtde_connection import RtdeConnection

SILENT_S = 0.15  # [s] without an answer: an object that is let go now would leave by a gripper that nobody hears
READ_MAX = 65536  # [bytes]


class GripperPort(Protocol):
    """One gripper, as the stream sees it.

    Attributes:
        quiet_s: time before its command to open in which nothing is asked [s].
        stays_open: what to say of one that does not close.
    """

    quiet_s: float
    stays_open: str

    def tell(self, opens: bool) -> None:
        """Tells it to open or to close."""
        ...

    def cycle(self, asks: bool = True) -> None:
        """Does what is due at this tick; with `asks` it may be asked for its state."""
        ...

    def is_open(self) -> bool | None:
        """Returns whether it is open, or opens; None where nobody can tell."""
        ...

    def is_closed(self) -> bool:
        """Returns whether it is known to be closed before its time to close is over."""
        ...

    def holds(self) -> bool | None:
        """Returns whether it holds an object; None where nobody can tell."""
        ...

    def not_holding(self) -> str:
        """Returns what shows that it holds nothing."""
        ...

    def problem(self) -> tuple[str, str] | None:
        """Returns outcome and reason where the gripper itself reports something, or nothing any more."""
        ...

    def finish(self) -> None:
        """Ends what would outlast the run, once the arm is at rest."""
        ...


def gripper_port(connection: RtdeConnection) -> GripperPort:
    """Returns what a run tells its gripper through."""
    job = connection.job
    if job.link is None:
        return OutputPort(connection)
    return SocketPort(connection) if job.gripper_fd >= 0 else NoPort()


class OutputPort:
    """A gripper on digital outputs, the second of which may last for a while only."""

    quiet_s = 0.0
    stays_open = "the gripper's output does not answer"

    def __init__(self, connection: RtdeConnection) -> None:
        self._connection = connection
        self._job = job = connection.job
        self._blows_until: float | None = None  # controller's time
        lines = [(job.output, job.output_index, job.output_level)]
        if job.second is not None and job.second.lasts_s is None:
            lines.append((job.second.output, job.second.index, job.second.open_level))
        self._mask = 0
        self._open_bits = 0
        for output, index, level in lines:
            bit = 1 << (OUTPUT_SHIFT[output] + index)
            self._mask |= bit
            self._open_bits |= bit if level else 0

    def tell(self, opens: bool) -> None:
        """Switches the outputs; what blows the object off is on when the vacuum goes."""
        job = self._job
        second = job.second
        if second is not None:
            self._connection.output(second.output, second.index, second.open_level == opens)
            self._blows_until = None
            if opens and second.lasts_s is not None:
                self._blows_until = self._connection.stamp + second.lasts_s
        self._connection.output(job.output, job.output_index, job.output_level == opens)

    def cycle(self, asks: bool = True) -> None:
        """Ends what lasts for a while only."""
        if self._blows_until is not None and self._connection.stamp >= self._blows_until:
            self._end_blowing()

    def is_open(self) -> bool:
        """Returns whether the outputs are at the levels that open it."""
        return self.opens(self._connection.outputs)

    def opens(self, outputs: int) -> bool:
        """Returns whether output bits open it."""
        return int(outputs) & self._mask == self._open_bits

    def is_closed(self) -> bool:
        """Returns False: an output does not tell when the fingers have arrived."""
        return False

    def holds(self) -> bool | None:
        """Returns what the input shows, where the cell has one for that."""
        return _input_level(self._connection)

    def not_holding(self) -> str:
        """Returns what the input shows of a gripper that holds nothing."""
        return _low_input(self._job)

    def problem(self) -> None:
        """Returns None: an output reports nothing."""
        return

    def finish(self) -> None:
        """Waits for the end of what lasts for a while, and ends it."""
        connection = self._connection
        while self._blows_until is not None:
            sleep(self._job.dt)
            before = connection.stamp
            connection.read()
            if connection.stamp != before:  # of a controller that sends none the daemon ends the run
                connection.memory.fields[shm.PULSE] = monotonic()
            self.cycle()

    def _end_blowing(self) -> None:
        second = self._job.second
        self._blows_until = None
        if second is not None:
            self._connection.output(second.output, second.index, not second.open_level)


class SocketPort:
    """A gripper behind an inherited socket."""

    def __init__(self, connection: RtdeConnection) -> None:
        self._connection = connection
        job = connection.job
        assert job.link is not None
        self._driver = driver_of(job.link)
        self._socket = socket.socket(fileno=job.gripper_fd)
        self._socket.setblocking(False)
        self._received = bytearray()
        self._unanswered = 0
        self._asked_at = 0.0  # the oldest request without an answer, or later
        self._failure = ""
        self._reports = 0
        self._reported_at = nan  # controller's time
        try:
            self._peer = self._socket.getpeername()
        except OSError as error:  # reset since the daemon found it ready
            self._failure = f"is lost: {error}"
        self._name = f"the gripper at {job.link.host or job.host}:{job.link.port}"
        self.quiet_s = self._driver.quiet_s
        self.stays_open = f"{self._name} did not close"

    def tell(self, opens: bool) -> None:
        """Sends the command in one write; a socket that does not take it is a problem of the next tick."""
        self._send(self._driver.tell(opens))

    def cycle(self, asks: bool = True) -> None:
        """Takes what has arrived, and asks the next question once the one before is answered."""
        self._receive()
        self._note_motion()
        now = monotonic()
        if self._unanswered > 0 and now - self._asked_at > SILENT_S:
            self._failure = self._failure or f"has not answered for {1e3 * (now - self._asked_at):.0f} ms"
        if asks and self._unanswered == 0 and (question := self._driver.question()):
            self._send(question)

    def is_open(self) -> bool | None:
        """Returns what the driver makes of the gripper's reports."""
        return self._driver.is_open()

    def is_closed(self) -> bool:
        """Returns whether the gripper reports that it is closed."""
        return self._driver.is_closed()

    def holds(self) -> bool | None:
        """Returns what the input shows, where the cell has one for that; else what the gripper reports."""
        level = _input_level(self._connection)
        return self._driver.holds() if level is None else level

    def not_holding(self) -> str:
        """Returns what shows that it holds nothing."""
        if self._connection.job.grip_input is not None:
            return _low_input(self._connection.job)
        return f"{self._name} reports no object"

    def problem(self) -> tuple[str, str] | None:
        """Returns outcome and reason of a gripper that is silent, faulty, or has lost its object."""
        if self._driver.has_lost_object():
            return "released_early", f"{self._name} lost the object: its fingers closed further"
        if self._failure:
            return "not_released", f"{self._name} {self._failure}"
        return ("not_released", f"{self._name}: {self._driver.fault}") if self._driver.fault else None

    def finish(self) -> None:
        """Has the connection end in order with this process, where all has arrived."""
        close_in_order(self._socket)

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()

    def _send(self, request: bytes) -> None:
        try:
            if self._socket.send(request) != len(request):
                self._failure = "takes no command"
        except OSError as error:
            self._failure = f"takes no command: {error}"
        if self._driver.answers:
            self._asked_at = monotonic() if self._unanswered == 0 else self._asked_at
            self._unanswered += 1

    def _note_motion(self) -> None:
        """Notes between which times the fingers began to open: what a report tells is no older than the one before."""
        count, moved = self._driver.motion() or (self._reports, False)
        if count == self._reports:
            return
        fields = self._connection.memory.fields
        if not moved:
            fields[shm.SHUT_AT_S] = self._reported_at
            fields[shm.MOVED_BY_S] = nan  # a digit that came and went
        elif isnan(fields[shm.MOVED_BY_S]):
            fields[shm.MOVED_BY_S] = self._connection.stamp
        self._reports = count
        self._reported_at = self._connection.stamp

    def _receive(self) -> None:
        ended = False
        try:
            while data := self._socket.recv(READ_MAX):
                self._received += data
            ended = True
        except BlockingIOError:
            pass
        except OSError as error:
            self._failure = f"is lost: {error}"
        answers = self._driver.take(self._received)
        if answers:
            self._unanswered = max(self._unanswered - answers, 0)
            self._asked_at = monotonic()
        if ended:
            self._reconnect()

    def _reconnect(self) -> None:
        """Opens another connection where that is usual, which takes less than a tick beside the next command."""
        if not self._driver.reconnects or self._unanswered > 0:
            self._failure = "closed the connection"
            return
        family = self._socket.family
        self._socket.close()
        self._received.clear()
        self._socket = socket.socket(family)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        discard_at_close(self._socket)
        self._socket.connect_ex(self._peer)


class NoPort:
    """A gripper that a run without a throw leaves alone, or a dry run."""

    quiet_s = 0.0
    stays_open = ""

    def tell(self, opens: bool) -> None:
        """Does nothing."""

    def cycle(self, asks: bool = True) -> None:
        """Does nothing."""

    def is_open(self) -> None:
        """Returns None."""
        return

    def is_closed(self) -> bool:
        """Returns True: it is not waited for."""
        return True

    def holds(self) -> None:
        """Returns None."""
        return

    def not_holding(self) -> str:
        """Returns nothing."""
        return ""

    def problem(self) -> None:
        """Returns None."""
        return

    def finish(self) -> None:
        """Does nothing."""


def _input_level(connection: RtdeConnection) -> bool | None:
    """Returns the level of the input that is high while the gripper holds an object; None without one."""
    number = connection.job.grip_input
    return None if number is None else bool(int(connection.inputs) >> number & 1)


def _low_input(job: StreamJob) -> str:
    return f"input {job.grip_input} is low"
