"""Client of a controller's primary interface: the table of its arm, as measured in the factory.

Source: Universal Robots, "Remote control via TCP/IP", and the parser of UR's client library (`KinematicsInfo`). In
robot states (type 16), kinematics info (type 5) carries a checksum a joint (6 uint32), DH theta, a, d, alpha (6 doubles
each), and the status of the calibration (uint32). Controllers before 3.6 send none.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

from executor.robot.primary_packages import PORT, take_packages
from planner.arrays import read_only
from planner.calibration import DhTable

TIMEOUT_S = 1.0  # [s] to connect
WAIT_S = 3.0  # [s] for the table: states come at 10 Hz, and the first on a connection has it
READER_WAIT_S = 0.5  # [s] within the executor's heartbeat: after two seconds without one it counts as gone
KEEP_S = 60.0  # [s] for which a table is good: an arm is changed with the power off
RETRY_S = 10.0  # [s] between two attempts
ROBOT_STATE = 16
KINEMATICS_INFO = 5
BODY = struct.Struct(">6I6d6d6d6dI")


@dataclass(frozen=True, eq=False)
class KinematicsInfo:
    """What a controller reports about its arm.

    Attributes:
        table: Denavit-Hartenberg table of the arm.
        checksums: of the joints (6,).
        status: of the calibration, as the controller counts.
    """

    table: DhTable
    checksums: tuple[int, ...]
    status: int


def read_kinematics(host: str, wait_s: float = WAIT_S) -> KinematicsInfo:
    """Returns what the controller at `host` reports about its arm, within `wait_s` [s].

    Raises:
        OSError: no connection, or no table in time.
        ValueError: what arrives is not the primary interface.
    """
    end = time.monotonic() + wait_s
    with socket.create_connection((host, PORT), min(TIMEOUT_S, wait_s)) as connection:
        for kind, body in _packages(connection, end):
            info = _kinematics(body) if kind == ROBOT_STATE else None
            if info is not None:
                return info
    raise ConnectionError("the controller closed the connection without reporting its kinematics")


def _packages(connection: socket.socket, end: float) -> Iterator[tuple[int, bytes]]:
    """Yields the type and body of each package until the connection ends.

    Raises:
        TimeoutError: the time `end`, on `time.monotonic`, has come.
    """
    buffer = bytearray()
    while True:
        yield from take_packages(buffer)
        connection.settimeout(max(end - time.monotonic(), 1e-3))
        received = connection.recv(65536)
        if not received:
            return
        buffer += received
        if time.monotonic() > end:
            raise TimeoutError("the controller does not report its kinematics")


def _kinematics(state: bytes) -> KinematicsInfo | None:
    """Returns the kinematics info in a robot state, None where it has none."""
    for kind, body in take_packages(bytearray(state)):
        if kind == KINEMATICS_INFO and len(body) >= BODY.size:
            numbers = BODY.unpack_from(body)
            theta, a, d, alpha = (read_only(numbers[i : i + 6]) for i in (6, 12, 18, 24))
            return KinematicsInfo(DhTable(theta, a, d, alpha), tuple(numbers[:6]), numbers[30])
    return None


class KinematicsReader:
    """What one controller reports about its arm, read again from time to time. Not safe for two threads."""

    def __init__(self, host: str) -> None:
        self.host = host
        self._info: KinematicsInfo | None = None
        self._due_at = 0.0

    def info(self) -> KinematicsInfo | None:
        """Returns the newest answer; None where the controller gives none."""
        return self._info if time.monotonic() < self._due_at else self.read(READER_WAIT_S)

    def forget(self) -> None:
        """Forgets what the controller told: the next question is asked anew."""
        self._due_at = 0.0

    def read(self, wait_s: float = WAIT_S) -> KinematicsInfo | None:
        """Asks the controller now, whatever it told before: another robot may answer at its address."""
        try:
            self._info = read_kinematics(self.host, wait_s)
        except (OSError, ValueError):
            self._info = None
        self._due_at = time.monotonic() + (RETRY_S if self._info is None else KEEP_S)
        return self._info
