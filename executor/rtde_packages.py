"""Packages of RTDE over a socket: the wire, and the set-up that every client begins with.

Wire format: Universal Robots, RTDE guide, version 2; big-endian, package = size (2), type (1), body.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from typing import NamedTuple

RTDE_PORT = 30004  # source: RTDE guide
PROTOCOL = 2
REQUEST_PROTOCOL = 86
CONTROLLER_VERSION = 118
SETUP_OUTPUTS = 79
SETUP_INPUTS = 73
START = 83
DATA = 85
NOT_FOUND = "NOT_FOUND"  # in the place of a type: the controller does not know the variable
IN_USE = "IN_USE"  # another client owns the input
ACCEPTED = b"\x01"
HEAD = struct.Struct(">HB")
RATE = struct.Struct(">d")


class Recipe(NamedTuple):
    """Variables that the controller has set up.

    Attributes:
        number: of the recipe, which begins its packages.
        types: one for each variable, in order.
    """

    number: int
    types: list[str]


class RtdePackages:
    """The packages of one connection. Each method raises `OSError` where the connection is lost."""

    def __init__(self, connection: socket.socket) -> None:
        """Agrees on version 2 of the protocol, within the connection's own timeout.

        Raises:
            ValueError: what answers there does not speak it.
        """
        self._socket = connection
        self._received = b""
        if self.ask(REQUEST_PROTOCOL, struct.pack(">H", PROTOCOL)) != ACCEPTED:
            raise ValueError(f"the controller does not speak version {PROTOCOL} of RTDE")

    def set_up_outputs(self, names: Sequence[str], rate_hz: float) -> Recipe:
        """Asks for variables that the controller publishes at a rate [Hz].

        Raises:
            ValueError: it does not answer for each of them.
        """
        return self._recipe(SETUP_OUTPUTS, RATE.pack(rate_hz), names)

    def set_up_inputs(self, names: Sequence[str]) -> Recipe:
        """Asks for variables that the controller takes.

        Raises:
            ValueError: it does not answer for each of them.
        """
        return self._recipe(SETUP_INPUTS, b"", names)

    def start(self) -> None:
        """Has the controller publish what was set up.

        Raises:
            ValueError: it does not.
        """
        if self.ask(START) != ACCEPTED:
            raise ValueError("the controller does not start to publish over RTDE")

    def ask(self, kind: int, body: bytes = b"") -> bytes:
        """Sends a package; returns the body of the answer, which is of the same kind.

        Raises:
            ValueError: the controller sent what is no package.
        """
        self._socket.sendall(package(kind, body))
        return self.receive(kind)

    def receive(self, kind: int) -> bytes:
        """Returns the body of the next package of a kind; passes over others.

        Raises:
            ValueError: the controller sent what is no package.
        """
        while True:
            size, found = HEAD.unpack_from(self._at_least(HEAD.size))
            if size < HEAD.size:
                raise ValueError("the controller sent a package shorter than its header")
            body = self._at_least(size)[HEAD.size : size]
            self._received = self._received[size:]
            if found == kind:
                return body

    def _at_least(self, count: int) -> bytes:
        """Returns what was received and not taken yet, once that is so many bytes."""
        while len(self._received) < count:
            data = self._socket.recv(65536)
            if not data:
                raise ConnectionError("the controller closed the connection")
            self._received += data
        return self._received

    def _recipe(self, kind: int, head: bytes, names: Sequence[str]) -> Recipe:
        answer = self.ask(kind, head + ",".join(names).encode())
        types = answer[1:].decode(errors="replace").split(",")
        if not answer or len(types) != len(names):
            raise ValueError(f"the controller answers {answer!r} to the set-up of {', '.join(names)}")
        return Recipe(answer[0], types)


def package(kind: int, body: bytes) -> bytes:
    """Returns the bytes of one package."""
    return HEAD.pack(HEAD.size + len(body), kind) + body
