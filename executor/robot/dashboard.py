"""Client of a controller's dashboard server, independent of ur_rtde.

Source: Universal Robots, "Dashboard Server": port 29999, one line in, one line out.
"""

from __future__ import annotations

import contextlib
import re
import socket

from executor.robot.operation import ActionRefused, ControlMode
from executor.undelivered import close_in_order, discard_at_close
from store import RobotAction

PORT = 29999
TIMEOUT_S = 0.5  # [s] a controller answers within milliseconds; heartbeats wait for this
LINE_MAX = 4096  # [bytes]
CONTROL_MODES: dict[str, ControlMode] = {"true": "remote", "false": "local"}  # of "is in remote control"
ACTIONS: dict[RobotAction, tuple[str, str]] = {  # action -> command, and how the answer begins where it is obeyed
    "power_on": ("power on", "Powering on"),
    "brake_release": ("brake release", "Brake releasing"),
    "unlock_protective_stop": ("unlock protective stop", "Protective stop releasing"),
    "power_off": ("power off", "Powering off"),
}
QUESTION = "robotmode"  # any that changes nothing
SERIAL_NUMBER = re.compile(r"[A-Za-z0-9]+")  # anything else is a complaint about the command


class DashboardClient:
    """One connection, opened when first needed and reopened after a failure. Not safe for two threads."""

    name = "dashboard"

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket: socket.socket | None = None

    def ask(self, line: str) -> str:
        """Returns the controller's answer to a question or a stop, which may come twice.

        Raises:
            OSError: no connection, or no answer in time.
        """
        if self._socket is not None:
            with contextlib.suppress(OSError):  # it has ended since the last command, or fell silent: reopen it
                return self._exchange(self._socket, line)
        return self._exchange(self._connect(), line)

    def control_mode(self) -> ControlMode:
        """Returns who controls the robot; "unknown" before 5.6, which does not tell.

        Raises:
            OSError: no answer in time.
        """
        return CONTROL_MODES.get(self.ask("is in remote control").lower(), "unknown")

    def serial_number(self) -> str | None:
        """Returns the robot's serial number; None from a version that does not tell it.

        Raises:
            OSError: no answer in time.
        """
        answer = self.ask("get serial number")
        return answer if SERIAL_NUMBER.fullmatch(answer) else None

    def act(self, action: RobotAction) -> None:
        """Operates the robot: the command is sent once, and dropped where it has not arrived.

        The arm must not get power once somebody was told that it did not.

        Raises:
            OSError: no answer in time.
            ActionRefused: the controller refuses it.
        """
        command, obeyed = ACTIONS[action]
        self.ask(QUESTION)  # over a connection that lives
        assert self._socket is not None
        answer = self._exchange(self._socket, command)
        if not answer.startswith(obeyed):
            raise ActionRefused(f"the dashboard refuses it: {answer}")

    def connect(self) -> None:
        """Opens the connection, unless it is open.

        Raises:
            OSError: the connection is refused, or the greeting is missing.
        """
        if self._socket is None:
            self._connect()

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._socket is not None:
            close_in_order(self._socket, 0.0)
            self._socket.close()
            self._socket = None

    def _exchange(self, connection: socket.socket, line: str) -> str:
        try:
            connection.sendall(line.encode() + b"\n")
            return self._read_line(connection)
        except OSError:
            self.close()
            raise

    def _connect(self) -> socket.socket:
        connection = socket.create_connection((self.host, PORT), TIMEOUT_S)
        self._socket = connection
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            discard_at_close(connection)
            self._read_line(connection)  # the greeting
        except OSError:
            self.close()
            raise
        return connection

    @staticmethod
    def _read_line(connection: socket.socket) -> str:
        data = b""
        while not data.endswith(b"\n") and len(data) < LINE_MAX:
            received = connection.recv(LINE_MAX)
            if not received:
                raise ConnectionError("the dashboard closed the connection")
            data += received
        return data.decode(errors="replace").strip()
