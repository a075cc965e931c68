"""Listens to a controller's primary interface: which program took the place of ours.

Source: Universal Robots, "Primary and secondary interfaces": port 30001; a package is int32 size, uint8 type and body,
a robot message (type 20) uint64 timestamp, int8 source, uint8 message type and fields; big-endian, ten times a second.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Iterator

PORT = 30001
CONNECT_S = 0.5  # [s] a controller answers within milliseconds; without this interface a run goes on
HEADER = struct.Struct(">iB")
MESSAGE = struct.Struct(">iBQbB")
KEY_HEADER = struct.Struct(">iiB")  # code, argument, length of the title
ROBOT_MESSAGE, KEY, RUNTIME_EXCEPTION = 20, 7, 10
PACKAGE_MAX = 1 << 20  # [bytes] a larger size is no package
OWN_PROGRAM = "rtde_control"  # source: ur_rtde 1.6.5
STARTED = "PROGRAM_XXX_STARTED"
COMPILE_ERRORS = ("compile_error", "syntax_error")  # first words of errors in a script that has just arrived


class ProgramWatch:
    """Follows the programs of a controller over its primary interface.

    Attributes:
        foreign: in words, which program or script took the place of ours since ours started; empty without one.
    """

    def __init__(self, host: str) -> None:
        self.host, self.foreign = host, ""
        self._own_started = False
        self._buffer = bytearray()
        self._socket: socket.socket | None = None

    def connect(self) -> None:
        """Connects; without this interface nothing is ever seen."""
        with contextlib.suppress(OSError):
            self._socket = socket.create_connection((self.host, PORT), CONNECT_S)
            self._socket.setblocking(False)

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._socket is not None:
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
        for package in self._packages():
            self.take(package)

    def wait(self, duration_s: float) -> str:
        """Waits for a foreign program up to `duration_s` [s]; returns `foreign`."""
        end = time.monotonic() + duration_s
        while self._socket is not None and not self.foreign and time.monotonic() < end:
            time.sleep(0.01)
            self.poll()
        return self.foreign

    def _packages(self) -> Iterator[bytes]:
        while len(self._buffer) >= HEADER.size:
            size, _ = HEADER.unpack_from(self._buffer)
            if not HEADER.size <= size <= PACKAGE_MAX:
                self.close()
                return
            if len(self._buffer) < size:
                return
            package = bytes(self._buffer[:size])
            del self._buffer[:size]
            yield package

    def take(self, package: bytes) -> None:
        """Takes in one package."""
        if package[4] != ROBOT_MESSAGE or len(package) < MESSAGE.size:
            return
        kind, body = package[MESSAGE.size - 1], package[MESSAGE.size :]
        if kind == KEY and len(body) >= KEY_HEADER.size:
            length = KEY_HEADER.size + body[KEY_HEADER.size - 1]
            self._key(body[KEY_HEADER.size : length].decode(errors="replace"), body[length:].decode(errors="replace"))
        elif kind == RUNTIME_EXCEPTION:
            text = body[8:].decode(errors="replace")  # after line and column
            if self._own_started and text.startswith(COMPILE_ERRORS):
                self.foreign = self.foreign or f"a script that did not compile ({text})"

    def _key(self, title: str, program: str) -> None:
        if program == OWN_PROGRAM:
            self._own_started = self._own_started or title == STARTED
        elif self._own_started:
            self.foreign = self.foreign or f"the program '{program}'"
