"""A second way to the gripper's output, for the daemon: hold the object when the streaming process cannot.

The output is set by a secondary program over the secondary client interface: it runs beside whatever plays, and needs
no RTDE input, which one client alone may own. Source: Universal Robots, URScript manual, secondary programs.
"""

from __future__ import annotations

import contextlib
import socket

PORT = 30002
CONNECT_S = 0.5  # [s] a controller answers within milliseconds; without this interface a run goes on
PROGRAM = "fling_hold"
FUNCTIONS = {
    "tool_digital": "set_tool_digital_out",
    "standard_digital": "set_standard_digital_out",
    "configurable_digital": "set_configurable_digital_out",
}


class GripperHold:
    """A connection that is opened before the run, so that one packet is enough."""

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket: socket.socket | None = None

    def connect(self) -> None:
        """Connects; without this interface nothing can be held."""
        with contextlib.suppress(OSError):
            self._socket = socket.create_connection((self.host, PORT), CONNECT_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.setblocking(False)

    def drain(self) -> None:
        """Discards the states that the controller sends here ten times a second; never waits."""
        if self._socket is not None:
            with contextlib.suppress(BlockingIOError, OSError):
                while self._socket.recv(65536):
                    pass

    def hold(self, output: str, index: int, level: bool) -> bool:
        """Sets an output to `level`; returns whether that was sent."""
        if self._socket is None:
            return False
        script = f"sec {PROGRAM}():\n  {FUNCTIONS[output]}({index}, {level})\nend\n"
        try:
            return self._socket.send(script.encode()) == len(script)
        except OSError:
            return False

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
