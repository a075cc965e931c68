"""Live state of the robot: an RTDE receiver in plain Python, independent of ur_rtde.

It subscribes to outputs only, so it can never move the arm, and it cannot hang the daemon as ur_rtde can.
Wire format: Universal Robots, RTDE guide; big-endian, package = size (2), type (1), body.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

PORT = 30004
TIMEOUT_S = 1.0  # [s] without a package the connection is lost
RETRY_S = 0.5  # [s] between two attempts to connect
RATE_HZ = 25.0  # [Hz] of the states; above the 4 Hz of the heartbeat
FRESH_S = 0.25  # [s] age at which a state is out of date
VERSION, SETUP_OUTPUTS, START, DATA = 86, 79, 83, 85
FORMATS = {"DOUBLE": "d", "UINT64": "Q", "UINT32": "I", "INT32": "i", "VECTOR6D": "6d"}
WANTED = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "target_qd",
    "robot_mode",
    "safety_status_bits",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_output_bits",
    "payload",
    "tcp_offset",
)


@dataclass(frozen=True)
class RobotState:
    """One state published by the controller.

    Attributes:
        seen_at: monotonic time of arrival [s].
        timestamp_s: the controller's time [s].
        q, qd: measured positions and velocities (6,) [rad, rad/s].
        target_qd: commanded velocities (6,) [rad/s].
        robot_mode, safety_bits, runtime_state: as in the RTDE guide.
        speed: speed scaling times slider [-].
        outputs: digital output bits.
        payload_kg: payload configured on the controller [kg]; None where its version does not publish it.
        tcp_offset: configured tool centre point (6,): position [m], rotation vector [rad]; None as above.
    """

    seen_at: float
    timestamp_s: float
    q: tuple[float, ...]
    qd: tuple[float, ...]
    target_qd: tuple[float, ...]
    robot_mode: int
    safety_bits: int
    runtime_state: int
    speed: float
    outputs: int
    payload_kg: float | None
    tcp_offset: tuple[float, ...] | None

    @property
    def age_s(self) -> float:
        """Time since its arrival [s]."""
        return time.monotonic() - self.seen_at


class Monitor:
    """Keeps the newest state in `state`, from a thread of its own; None without a connection."""

    def __init__(self, host: str) -> None:
        self.host = host
        self.state: RobotState | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._receive, name="monitor", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._thread.join(2.0 * TIMEOUT_S)

    def fresh(self, within_s: float = FRESH_S) -> RobotState | None:
        """Returns the newest state; None where it is older than `within_s` [s]."""
        state = self.state
        return state if state is not None and state.age_s <= within_s else None

    def _receive(self) -> None:
        while not self._ended.is_set():
            try:
                with socket.create_connection((self.host, PORT), TIMEOUT_S) as connection:
                    RtdeReceiver(connection).follow(self._set_state, self._ended)
            except (OSError, struct.error, ValueError):
                self._ended.wait(RETRY_S)
            self.state = None

    def _set_state(self, state: RobotState) -> None:
        self.state = state


class RtdeReceiver:
    """One RTDE connection, set up and started, that receives states."""

    def __init__(self, connection: socket.socket, rate_hz: float = RATE_HZ) -> None:
        self.socket, self.rate_hz = connection, rate_hz
        self.buffer = b""
        self._send(VERSION, struct.pack(">H", 2))
        self._await(VERSION)
        self.names = self._set_up([*WANTED])
        self._send(START, b"")
        self._await(START)

    def follow(self, receive: Callable[[RobotState], None], ended: threading.Event) -> None:
        """Calls `receive` with every state until `ended`.

        Raises:
            OSError: the connection is lost.
        """
        while not ended.is_set():
            body = self._await(DATA)
            values = dict(zip(self.names, self._unpack(body), strict=True))
            receive(_state(values))

    def timestamps(self, duration_s: float) -> list[tuple[float, float]]:
        """Returns (monotonic arrival time, controller time) of every package received within `duration_s` [s].

        Raises:
            OSError: the connection is lost.
        """
        found: list[tuple[float, float]] = []
        end = time.monotonic() + duration_s
        while time.monotonic() < end:
            body = self._await(DATA)
            found.append((time.monotonic(), self._unpack(body)[0]))
        return found

    def _set_up(self, names: list[str]) -> list[str]:
        self._send(SETUP_OUTPUTS, struct.pack(">d", self.rate_hz) + ",".join(names).encode())
        types = self._await(SETUP_OUTPUTS)[1:].decode().split(",")
        known = [name for name, kind in zip(names, types, strict=True) if kind != "NOT_FOUND"]
        if known != names:
            return self._set_up(known)
        self.widths = [6 if kind.startswith("VECTOR6") else 1 for kind in types]
        self.struct = struct.Struct(">B" + "".join(FORMATS[kind] for kind in types))
        return names

    def _unpack(self, body: bytes) -> list[Any]:
        flat = self.struct.unpack(body)[1:]
        values, at = [], 0
        for width in self.widths:
            values.append(flat[at] if width == 1 else flat[at : at + width])
            at += width
        return values

    def _send(self, kind: int, body: bytes) -> None:
        self.socket.sendall(struct.pack(">HB", 3 + len(body), kind) + body)

    def _await(self, kind: int) -> bytes:
        """Returns the body of the next package of this kind, skipping others."""
        while True:
            while len(self.buffer) < 3 or len(self.buffer) < struct.unpack_from(">H", self.buffer)[0]:
                received = self.socket.recv(65536)
                if not received:
                    raise ConnectionError("the controller closed the connection")
                self.buffer += received
            size, found = struct.unpack_from(">HB", self.buffer)
            body, self.buffer = self.buffer[3:size], self.buffer[size:]
            if size < 3:
                raise ValueError("a package without a header")
            if found == kind:
                return body


def receive_timestamps(host: str, rate_hz: float, duration_s: float) -> list[tuple[float, float]]:
    """Returns (monotonic arrival time, controller time) of the packages that `host` publishes at `rate_hz` [s].

    Raises:
        OSError: no connection, or it was lost.
        ValueError: the controller does not speak RTDE.
    """
    with socket.create_connection((host, PORT), TIMEOUT_S) as connection:
        return RtdeReceiver(connection, rate_hz).timestamps(duration_s)


def _state(values: dict[str, Any]) -> RobotState:
    return RobotState(
        seen_at=time.monotonic(),
        timestamp_s=values["timestamp"],
        q=values["actual_q"],
        qd=values["actual_qd"],
        target_qd=values["target_qd"],
        robot_mode=values["robot_mode"],
        safety_bits=values["safety_status_bits"],
        runtime_state=values["runtime_state"],
        speed=values["speed_scaling"] * values["target_speed_fraction"],
        outputs=values["actual_digital_output_bits"],
        payload_kg=values.get("payload"),
        tcp_offset=values.get("tcp_offset"),
    )
