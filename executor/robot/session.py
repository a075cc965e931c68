"""The session with one robot: cell, settings, operation and live state.

The live state comes from an RTDE receiver in plain Python, independent of ur_rtde. It subscribes to outputs, and
at most keeps one input that no program reads: it can never move the arm, and cannot hang the daemon as ur_rtde can.
`set_outputs` writes digital outputs over a connection of its own, whatever state the arm is in.
Names and types of the variables: Universal Robots, RTDE guide.
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from executor.robot.console import Console
from executor.robot.kinematics_client import KinematicsInfo, KinematicsReader
from executor.rtde_packages import (
    CONTROLLER_VERSION,
    DATA,
    IN_USE,
    NOT_FOUND,
    RTDE_PORT,
    RtdePackages,
    package,
)
from executor.settings import ExecutorSettings
from executor.streaming.state_checks import NORMAL, OUTPUT_SHIFT, POWER_ON
from executor.undelivered import discard_at_close
from executor.worker import Worker
from planner.cell import Cell
from planner.controller_program import SwitchRow

TIMEOUT_S = 1.0  # [s] without a package the connection is lost
RETRY_S = 0.5  # [s] between two attempts to connect
RATE_HZ = 125.0  # [Hz] of the states, the rate of a CB3: where an object left is read from them
HISTORY = 500  # states kept: four seconds, in which a motion stops and its object lands
FRESH_S = 0.25  # [s] age at which a state is out of date
OWNER_INPUT = "input_bit_register_127"  # the last of those for RTDE clients (64 to 127); source: RTDE guide, inputs
SET_WITHIN_S = 0.5  # [s] for outputs to take their levels, delays of the outputs included
SET_AGAIN_S = 0.005  # [s] between two attempts
RECLAIM_S = 1.0  # [s] after which a controller is asked again for an input that another connection has
CONTROLLER_VERSION_BODY = struct.Struct(">3I")  # major, minor, bugfix; a build number may follow
FORMATS = {"DOUBLE": "d", "UINT64": "Q", "UINT32": "I", "INT32": "i", "VECTOR6D": "6d"}
OUTPUTS = {  # RTDE outputs, and the fields of `RobotState` that they fill
    "timestamp": "timestamp_s",
    "actual_q": "q",
    "actual_qd": "qd",
    "target_qd": "target_qd",
    "robot_mode": "robot_mode",
    "safety_status_bits": "safety_bits",
    "runtime_state": "runtime_state",
    "speed_scaling": "speed",
    "target_speed_fraction": "slider",
    "actual_digital_output_bits": "outputs",
    "actual_digital_input_bits": "inputs",
    "payload": "payload_kg",
    "tcp_offset": "tcp_offset",
}
OPTIONAL = {"payload", "tcp_offset"}  # outputs that older controllers do not publish


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
        outputs, inputs: digital output and input bits.
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
    payload_kg: float | None = None
    tcp_offset: tuple[float, ...] | None = None
    inputs: int = 0


class Monitor(Worker):
    """Keeps the newest state in `state`; None without a connection.

    Attributes:
        stop_seen: the first state with a safety stop or without power since `forget`; None without one.
        history: the newest states since `forget`, in order.
        owned: whether this connection has `OWNER_INPUT`; None without a connection, or where it does not ask for it.
        version: of the controller's software; None without a connection.
        looked: set once it has tried to connect.
    """

    def __init__(self, host: str, owns: bool = False) -> None:
        """Prepares it; with `owns` its connection asks for `OWNER_INPUT`."""
        super().__init__("monitor")
        self.host = host
        self.state: RobotState | None = None
        self.stop_seen: RobotState | None = None
        self.history: deque[RobotState] = deque(maxlen=HISTORY)
        self.owned: bool | None = None
        self.version: tuple[int, ...] | None = None
        self.looked = threading.Event()
        self._owns = owns

    def fresh(self) -> RobotState | None:
        """Returns the newest state; None where it is out of date."""
        state = self.state
        return state if state is not None and time.monotonic() - state.seen_at <= FRESH_S else None

    def run(self) -> None:
        """Receives states until the end, over a new connection after each failure."""
        while not self.ended.is_set():
            try:
                with socket.create_connection((self.host, RTDE_PORT), TIMEOUT_S) as connection:
                    receiver = RtdeReceiver(connection, inputs=[OWNER_INPUT] if self._owns else [])
                    self.owned = receiver.owned
                    self.version = receiver.version
                    self._follow(receiver)
            except (OSError, ValueError):
                self.state = None
                self.owned = None
                self.version = None
                self.looked.set()
                self.ended.wait(RETRY_S)

    def _follow(self, receiver: RtdeReceiver) -> None:
        """Receives states; for a while only over a connection that is refused the input, which may be free again."""
        end = time.monotonic() + (RECLAIM_S if receiver.owned is False else math.inf)
        while not self.ended.is_set() and time.monotonic() < end:
            self.state = state = receiver.receive()
            self.history.append(state)
            self.looked.set()
            if self.stop_seen is None and (state.safety_bits != NORMAL or state.robot_mode < POWER_ON):
                self.stop_seen = state

    def forget(self) -> None:
        """Forgets what was seen: a run begins."""
        self.stop_seen = None
        self.history.clear()


class RtdeReceiver:
    """One RTDE connection, set up and started, that receives states.

    Attributes:
        owned: whether the connection has its inputs; None where it did not ask, or the controller lacks one.
        version: of the controller's software: major, minor, bugfix.
    """

    def __init__(self, connection: socket.socket, rate_hz: float = RATE_HZ, inputs: Sequence[str] = ()) -> None:
        """Sets the connection up.

        Args:
            connection: to the RTDE port.
            rate_hz: of the states [Hz].
            inputs: that it asks for.

        Raises:
            OSError: the connection is lost.
            ValueError: this is no RTDE, or not that of an arm.
        """
        self._socket = connection
        self._packages = RtdePackages(connection)
        self.version = self._controller_version(self._packages.ask(CONTROLLER_VERSION))
        self._set_up([*OUTPUTS], rate_hz)
        self.owned = self._claim(inputs) if inputs else None
        self._packages.start()

    def receive(self) -> RobotState:
        """Returns the next state.

        Raises:
            OSError: the connection is lost.
            ValueError: this is no state.
        """
        body = self._packages.receive(DATA)
        seen_at = time.monotonic()
        fields = dict(zip(self._fields, self._unpack(body), strict=True))
        fields["speed"] *= fields.pop("slider")
        return RobotState(seen_at, **fields)

    @staticmethod
    def _controller_version(body: bytes) -> tuple[int, ...]:
        if len(body) < CONTROLLER_VERSION_BODY.size:
            raise ValueError("the controller does not tell its version")
        return CONTROLLER_VERSION_BODY.unpack_from(body)

    def _set_up(self, names: list[str], rate_hz: float) -> None:
        types = self._packages.set_up_outputs(names, rate_hz).types
        known = [name for name, kind in zip(names, types, strict=True) if kind != NOT_FOUND]
        if missing := set(OUTPUTS) - set(known) - OPTIONAL:
            raise ValueError(f"the controller does not publish {', '.join(sorted(missing))}")
        if known != names:
            self._set_up(known, rate_hz)
            return
        if unknown := set(types) - FORMATS.keys():
            raise ValueError(f"the controller publishes types that RTDE does not have: {', '.join(sorted(unknown))}")
        self._widths = [6 if kind.startswith("VECTOR6") else 1 for kind in types]
        self._struct = struct.Struct(">B" + "".join(FORMATS[kind] for kind in types))
        self._fields = [OUTPUTS[name] for name in names]

    def write(self, values: bytes) -> None:
        """Sends the values of the inputs.

        Raises:
            OSError: the connection is lost.
        """
        self._socket.sendall(package(DATA, bytes([self._recipe]) + values))

    def _claim(self, inputs: Sequence[str]) -> bool | None:
        """Asks for inputs; returns whether they are this connection's now."""
        self._recipe, types = self._packages.set_up_inputs(inputs)
        return None if NOT_FOUND in types else IN_USE not in types

    def _unpack(self, body: bytes) -> list[Any]:
        if len(body) != self._struct.size:
            raise ValueError(f"the controller sent a state of {len(body)} bytes, not {self._struct.size}")
        flat = self._struct.unpack(body)[1:]
        values = []
        at = 0
        for width in self._widths:
            values.append(flat[at] if width == 1 else flat[at : at + width])
            at += width
        return values


def set_outputs(host: str, levels: Sequence[SwitchRow]) -> list[SwitchRow]:
    """Gives digital outputs their levels, in one package; returns those that are not seen to have them soon after.

    The controller takes it in every state, also where it runs no program.
    """
    end = time.monotonic() + SET_WITHIN_S
    while levels and time.monotonic() < end:
        with suppress(OSError, ValueError), socket.create_connection((host, RTDE_PORT), SET_WITHIN_S) as connection:
            discard_at_close(connection)  # what is told as not switched must not switch later
            if _writes_outputs(connection, levels, end):
                return []
        time.sleep(SET_AGAIN_S)  # the connection of a process that has just ended may still own the outputs
    return list(levels)


def _writes_outputs(connection: socket.socket, levels: Sequence[SwitchRow], end: float) -> bool:
    """Returns whether outputs got their levels over a connection before a monotonic time [s]."""
    masks = dict.fromkeys([each.output for each in levels], 0)
    values = dict(masks)
    wanted: dict[int, bool] = {}
    for each in levels:
        masks[each.output] |= 1 << each.index
        values[each.output] |= each.level << each.index
        wanted[OUTPUT_SHIFT[each.output] + each.index] = each.level
    names = [f"{kind}{part}" for kind in masks for part in ("_output_mask", "_output")]
    receiver = RtdeReceiver(connection, inputs=names)
    if not receiver.owned:
        return False
    receiver.write(bytes(number for kind in masks for number in (masks[kind], values[kind])))
    while time.monotonic() < end:
        outputs = receiver.receive().outputs
        if all(bool(outputs >> bit & 1) == level for bit, level in wanted.items()):
            return True
    return False


def receive_timestamps(host: str, rate_hz: float, duration_s: float) -> list[tuple[float, float]]:
    """Returns (monotonic arrival time, controller time) of the packages that `host` publishes at `rate_hz` [s].

    Raises:
        OSError: no connection, or it was lost.
        ValueError: the controller does not speak RTDE.
    """
    with socket.create_connection((host, RTDE_PORT), TIMEOUT_S) as connection:
        receiver = RtdeReceiver(connection, rate_hz)
        found = []
        end = time.monotonic() + duration_s
        while time.monotonic() < end:
            state = receiver.receive()
            found.append((state.seen_at, state.timestamp_s))
        return found


@dataclass
class RobotSession:
    """Cell, settings and connections. Each thread needs a session of its own; they may share a monitor."""

    cell: Cell
    settings: ExecutorSettings
    monitor: Monitor
    console: Console
    kinematics_reader: KinematicsReader

    @classmethod
    def open(cls, cell: Cell, settings: ExecutorSettings, monitor: Monitor | None = None) -> RobotSession:
        """Returns a session with a console of its own, and with `monitor` or a new one."""
        host = cell.link.host
        monitor = monitor or Monitor(host, owns=not settings.read_only)
        return cls(cell, settings, monitor, Console(host), KinematicsReader(host))

    def kinematics(self) -> KinematicsInfo | None:
        """Returns what the controller reports about its arm; None without an answer."""
        return self.kinematics_reader.info()


def robot_document(
    state: RobotState | None,
    refusals: list[str],
    warnings: list[str] | None = None,
    serial_number: str | None = None,
    version: tuple[int, ...] | None = None,
) -> dict[str, Any]:
    """Returns the live state as `GET /cells/{name}/state` shows it.

    Args:
        state: of the robot; None without a connection.
        refusals: reasons not to move.
        warnings: what does not keep it from moving, and a person should know.
        serial_number: of the robot; None where its controller does not tell it.
        version: of the controller's software; None where it is not known yet.
    """
    findings = {"refusals": refusals, "warnings": warnings or []}
    if state is None:
        return {"connected": False, **findings}
    return {
        "connected": True,
        **findings,
        "serial_number": serial_number,
        "polyscope": None if version is None else ".".join(map(str, version)),
        "timestamp_s": state.timestamp_s,
        "positions": list(state.q),
        "velocities": list(state.qd),
        "robot_mode": state.robot_mode,
        "safety_status_bits": state.safety_bits,
        "runtime_state": state.runtime_state,
        "speed_scaling": state.speed,
        "digital_output_bits": state.outputs,
        "digital_input_bits": state.inputs,
        "payload_kg": state.payload_kg,
        "tcp_offset": None if state.tcp_offset is None else list(state.tcp_offset),
    }
