"""What answers at a controller's address: which arm, software and settings, asked of whatever interface is there."""

from __future__ import annotations

import socket
from contextlib import suppress
from dataclasses import dataclass

from executor.robot.console import Console
from executor.robot.kinematics_client import KinematicsInfo, read_kinematics
from executor.robot.operation import ControlMode
from executor.robot.session import TIMEOUT_S, RobotState, RtdeReceiver
from executor.rtde_packages import RTDE_PORT


@dataclass(frozen=True)
class FoundRobot:
    """What a controller told; what it did not tell is None.

    Attributes:
        polyscope: version of its software, as "5.11.1".
        state: of the robot.
        kinematics: of its arm.
        serial: number of the robot.
        control: who controls the robot.
        interface: that told it.
    """

    polyscope: str | None = None
    state: RobotState | None = None
    kinematics: KinematicsInfo | None = None
    serial: str | None = None
    control: ControlMode | None = None
    interface: str | None = None

    @property
    def is_there(self) -> bool:
        """Whether anything answered."""
        return self != FoundRobot()


def find_robot(host: str) -> FoundRobot:
    """Returns what the controller at `host` tells, within some seconds; nothing where none is there."""
    polyscope = None
    state = None
    kinematics = None
    with suppress(OSError, ValueError), socket.create_connection((host, RTDE_PORT), TIMEOUT_S) as connection:
        receiver = RtdeReceiver(connection)
        state = receiver.receive()
        polyscope = ".".join(map(str, receiver.version))
    with suppress(OSError, ValueError):
        kinematics = read_kinematics(host)
    console = Console(host)
    serial = console.serial_number()
    control = console.control_mode()
    interface = None if console.interface is None else console.interface.name
    console.close()
    return FoundRobot(polyscope, state, kinematics, serial, control, interface)
