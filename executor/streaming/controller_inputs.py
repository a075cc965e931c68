"""What a run writes at the controller: digital outputs and integer registers, over an RTDE connection of its own.

ur_rtde's interface for this sleeps for a tenth of a second while it connects, connects again by itself where a
connection is lost, and hears nothing: that it is cut shows when an output does not switch. This one writes at once,
never connects again, and has the controller send its time: a silent connection is a lost one.
Wire format: Universal Robots, RTDE guide; big-endian, package = size (2), type (1), body.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence

from executor.streaming.library_sockets import RTDE_PORT
from planner.controller_program import HEARTBEAT, REQUEST

CONNECT_S = 1.0  # [s] for every answer: a controller answers within milliseconds
HEAD = struct.Struct(">HB")
PROTOCOL = 2
REQUEST_PROTOCOL = 86
SETUP_OUTPUTS = 79
SETUP_INPUTS = 73
START = 83
DATA = 85
UNUSABLE = {"NOT_FOUND": "unknown to it", "IN_USE": "in use by another client"}
OUTPUTS = ("standard_digital", "configurable_digital", "tool_digital")
OUTPUT_VALUES = struct.Struct(">BBB")  # recipe, mask, levels
REGISTER_VALUE = struct.Struct(">Bi")  # recipe, value


class ControllerInputs:
    """An RTDE connection that owns every digital output, and the registers of a program that it keeps alive."""

    def __init__(self, host: str, rate_hz: float, keeps_alive: bool = False) -> None:
        """Connects; with `keeps_alive` it asks for the registers `HEARTBEAT` and `REQUEST`, too.

        Args:
            host: the controller.
            rate_hz: of its packages [Hz]: at its own rate a package that is lost on the way is soon followed by those
                for which TCP sends it again.
            keeps_alive: whether this run keeps a program alive.

        Raises:
            OSError: no connection, or no answer.
            ValueError: this is no RTDE, or another client owns what this one asks for.
        """
        self._received = b""
        self._socket = socket.create_connection((host, RTDE_PORT), CONNECT_S)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._answer(REQUEST_PROTOCOL, struct.pack(">H", PROTOCOL)) != b"\x01":
                raise ValueError(f"the controller does not speak version {PROTOCOL} of RTDE")
            self._answer(SETUP_OUTPUTS, struct.pack(">d", rate_hz) + b"timestamp")
            self._outputs = {kind: self._recipe([f"{kind}_output_mask", f"{kind}_output"]) for kind in OUTPUTS}
            numbers = (HEARTBEAT, REQUEST) if keeps_alive else ()
            self._registers = {number: self._recipe([f"input_int_register_{number}"]) for number in numbers}
            if self._answer(START) != b"\x01":
                raise ValueError("the controller does not start to send its time")
            self._socket.setblocking(False)
        except (OSError, ValueError):
            self._socket.close()
            raise

    def heard(self) -> bool:
        """Returns whether the controller has sent something since this was asked last.

        Raises:
            OSError: the connection is lost.
        """
        found = False
        try:
            while self._socket.recv(4096):
                found = True
        except BlockingIOError:
            return found
        raise ConnectionError("the controller closed it")

    def set_output(self, kind: str, index: int, level: bool) -> bool:
        """Sets one digital output of a kind of `OUTPUTS`; returns whether that was sent.

        Raises:
            OSError: the connection is lost.
        """
        bit = 1 << index
        return self._write(OUTPUT_VALUES.pack(self._outputs[kind], bit, bit if level else 0))

    def set_register(self, number: int, value: int) -> bool:
        """Sets one integer register; returns whether that was sent.

        Raises:
            OSError: the connection is lost.
        """
        return self._write(REGISTER_VALUE.pack(self._registers[number], value))

    def _write(self, body: bytes) -> bool:
        package = HEAD.pack(HEAD.size + len(body), DATA) + body
        return self._socket.send(package) == len(package)

    def _recipe(self, names: Sequence[str]) -> int:
        """Returns the number under which the controller takes values of these variables."""
        answer = self._answer(SETUP_INPUTS, ",".join(names).encode())
        if not answer:
            raise ValueError(f"the controller does not answer for the inputs {', '.join(names)}")
        types = answer[1:].decode(errors="replace").split(",")
        refused = [f"{name} is {UNUSABLE[kind]}" for name, kind in zip(names, types, strict=False) if kind in UNUSABLE]
        if refused or len(types) != len(names):
            raise ValueError(f"the controller does not take inputs: {', '.join(refused) or repr(answer)}")
        return answer[0]

    def _answer(self, kind: int, body: bytes = b"") -> bytes:
        """Sends a package; returns the body of the answer of the same kind."""
        self._socket.sendall(HEAD.pack(HEAD.size + len(body), kind) + body)
        while True:
            size, found = HEAD.unpack(self._take(HEAD.size))
            if size < HEAD.size:
                raise ValueError("the controller sent a package shorter than its header")
            answer = self._take(size - HEAD.size)
            if found == kind:
                return answer

    def _take(self, count: int) -> bytes:
        """Returns the next bytes of the connection."""
        while len(self._received) < count:
            data = self._socket.recv(4096)
            if not data:
                raise ConnectionError("the controller closed the connection")
            self._received += data
        taken = self._received[:count]
        self._received = self._received[count:]
        return taken
