"""What a run writes at the controller: digital outputs and integer registers, over an RTDE connection of its own.

ur_rtde's interface for this sleeps for a tenth of a second while it connects, connects again by itself where a
connection is lost, and hears nothing: that it is cut shows when an output does not switch. This one writes at once,
never connects again, and has the controller send its time: a silent connection is a lost one.
Names and types of the inputs: Universal Robots, RTDE guide.
"""

from __future__ import annotations

import socket
import struct

from executor.rtde_packages import DATA, IN_USE, NOT_FOUND, RTDE_PORT, RtdePackages, package
from planner.controller_program import HEARTBEAT, REQUEST

CONNECT_S = 1.0  # [s] for every answer: a controller answers within milliseconds
UNUSABLE = {NOT_FOUND: "unknown to it", IN_USE: "in use by another client"}
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
        self._socket = socket.create_connection((host, RTDE_PORT), CONNECT_S)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            packages = RtdePackages(self._socket)
            packages.set_up_outputs(["timestamp"], rate_hz)
            self._outputs = {kind: _input(packages, f"{kind}_output_mask", f"{kind}_output") for kind in OUTPUTS}
            numbers = (HEARTBEAT, REQUEST) if keeps_alive else ()
            self._registers = {number: _input(packages, f"input_int_register_{number}") for number in numbers}
            packages.start()
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
        whole = package(DATA, body)
        return self._socket.send(whole) == len(whole)


def _input(packages: RtdePackages, *names: str) -> int:
    """Returns the number of the recipe with which the controller takes values of these variables."""
    recipe = packages.set_up_inputs(names)
    refused = [
        f"{name} is {UNUSABLE[kind]}" for name, kind in zip(names, recipe.types, strict=True) if kind in UNUSABLE
    ]
    if refused:
        raise ValueError(f"the controller does not take inputs: {', '.join(refused)}")
    return recipe.number
