"""The table of drivers: adding a kind is a module and a line here."""

from __future__ import annotations

from collections.abc import Callable

from executor.grippers.calls import HttpGripper, ScriptGripper
from executor.grippers.onrobot import OnRobotGripper
from executor.grippers.protocol import GripperDriver
from executor.grippers.robotiq import RobotiqSerial, RobotiqSocket
from planner.grippers import GripperLink

DRIVERS: dict[tuple[str, str], Callable[[GripperLink], GripperDriver]] = {  # by kind and transport
    ("robotiq", "socket"): RobotiqSocket,
    ("robotiq", "tool_serial"): RobotiqSerial,
    ("onrobot", "modbus_tcp"): OnRobotGripper,
    ("script", ""): ScriptGripper,
    ("http", ""): HttpGripper,
}


def driver_of(link: GripperLink) -> GripperDriver:
    """Returns the driver of a gripper."""
    return DRIVERS[link.kind, link.transport](link)
