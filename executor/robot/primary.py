"""A controller's primary interface: which program took the place of ours, and the stop of last resort.

Source: Universal Robots, "Primary and secondary interfaces": the body of a robot message (type 20) is a timestamp
(uint64), its source (int8), its own type (uint8) and fields. The line that ends a program is that of UR's client
library, `PrimaryClient::commandStop`. Every controller has this interface; PolyScope X has no dashboard.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from executor.grippers import PROGRAM as GRIPPER_PROGRAM
from executor.robot.primary_packages import PORT, take_packages
from executor.undelivered import close_in_order, discard_at_close
from planner.controller_program import PROGRAM

CONNECT_S = 0.5  # [s] a controller answers within milliseconds; without this interface a run goes on
MESSAGE = struct.Struct(">QbB")
KEY_HEADER = struct.Struct(">iiB")  # code, argument, length of the title
ROBOT_MESSAGE = 20
KEY = 7
RUNTIME_EXCEPTION = 10
STOP = b"stop program\n"
TAKEN_S = 0.2  # [s] a connection stays open after a stop: the controller looks at it once a cycle
OWN_PROGRAMS = ("rtde_control", PROGRAM)  # source: ur_rtde 1.6.5; that of a motion inside the controller
STARTED = "PROGRAM_XXX_STARTED"
COMPILE_ERRORS = ("compile_error", "syntax_error")  # first words of errors in a script that has just arrived


class ProgramWatch:
    """Follows the programs of a controller over its primary interface.

    Attributes:
        foreign: in words, which program or script took the place of ours since ours started; empty without one.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self.foreign = ""
        self._own_started = False
        self._buffer = bytearray()
        self._socket: socket.socket | None = None

    def connect(self) -> None:
        """Connects; without this interface no foreign program is noticed."""
        with contextlib.suppress(OSError):
            self._socket = socket.create_connection((self.host, PORT), CONNECT_S)
            discard_at_close(self._socket)
            self._socket.setblocking(False)

    @property
    def is_connected(self) -> bool:
        """Whether the interface answered, and has not ended the connection."""
        return self._socket is not None

    def stop(self) -> None:
        """Ends whatever program plays, over a connection of its own where this one has ended."""
        try:
            if self._socket is not None and self._socket.send(STOP) == len(STOP):
                return
        except OSError:
            pass
        stop_program(self.host)

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._socket is not None:
            close_in_order(self._socket)
            self._socket.close()
            self._socket = None

    def poll(self) -> None:
        """Takes in what has arrived; never waits."""
        if self._socket is None:
            return
        try:
            data = self._socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self._buffer += data
        try:
            for kind, body in take_packages(self._buffer):
                self._take(kind, body)
        except ValueError:
            self.close()

    def wait(self, duration_s: float) -> str:
        """Waits for a foreign program up to `duration_s` [s]; returns `foreign`."""
        end = time.monotonic() + duration_s
        while self._socket is not None and not self.foreign and time.monotonic() < end:
            time.sleep(0.01)
            self.poll()
        return self.foreign

    def _take(self, kind: int, body: bytes) -> None:
        if kind != ROBOT_MESSAGE or len(body) < MESSAGE.size:
            return
        message = body[MESSAGE.size - 1]
        fields = body[MESSAGE.size :]
        if message == KEY and len(fields) >= KEY_HEADER.size:
            length = KEY_HEADER.size + fields[KEY_HEADER.size - 1]
            title = fields[KEY_HEADER.size : length]
            program = fields[length:]
            self._key(title.decode(errors="replace"), program.decode(errors="replace"))
        elif message == RUNTIME_EXCEPTION:
            text = fields[8:].decode(errors="replace")  # after line and column
            if self._own_started and text.startswith(COMPILE_ERRORS):
                self.foreign = self.foreign or f"a script that did not compile ({text})"

    def _key(self, title: str, program: str) -> None:
        if program in OWN_PROGRAMS:
            self._own_started = self._own_started or title == STARTED
        elif self._own_started and program != GRIPPER_PROGRAM:
            self.foreign = self.foreign or f"the program '{program}'"


def stop_program(host: str) -> None:
    """Ends whatever program plays on the controller at `host`; does nothing where its primary interface is not there.

    What the controller sends meanwhile is read: a connection closed over unread data is reset, and may lose the stop.
    """
    with contextlib.suppress(OSError), socket.create_connection((host, PORT), CONNECT_S) as connection:
        discard_at_close(connection)
        connection.sendall(STOP)
        with contextlib.suppress(OSError):
            _read_for(connection, TAKEN_S)
        close_in_order(connection)


def _read_for(connection: socket.socket, duration_s: float) -> None:
    """Discards what arrives for a while [s], or until the connection ends."""
    end = time.monotonic() + duration_s
    while (left := end - time.monotonic()) > 0.0:
        connection.settimeout(left)
        if not connection.recv(65536):
            return
