"""The ports at which a cell's gripper is reached; adding a twin is a module and a line here."""

from __future__ import annotations

import socket
from collections.abc import Callable

from planner.cell import Gripper
from planner.grippers import GripperLink
from simulator.grippers.http import HttpTwin
from simulator.grippers.modbus import ModbusServer, RtuFraming, TcpFraming
from simulator.grippers.onrobot import FingerRegisters, VacuumRegisters
from simulator.grippers.robotiq import RobotiqRegisters, RobotiqServer, RobotiqState
from simulator.interfaces import ConnectionHandler, ServicePort
from simulator.physics import SimulatedGripper

PORT_NAME = "gripper"


def gripper_ports(gripper: Gripper, simulated: SimulatedGripper, host: str) -> list[ServicePort]:
    """Returns the ports of a gripper's twin; none where outputs switch it, or where it is at another address.

    Args:
        gripper: of the cell file.
        simulated: what the twin moves.
        host: address of the simulated controller.
    """
    link = gripper.link
    if link is None or link.kind == "script" or not _is_here(link.host, host):
        return []
    return [ServicePort(PORT_NAME, link.port, TWINS[link.kind, link.transport](link, simulated))]


def _onrobot(link: GripperLink, simulated: SimulatedGripper) -> ConnectionHandler:
    registers = FingerRegisters(simulated) if link.stroke_m > 0.0 else VacuumRegisters(simulated)
    return ModbusServer(TcpFraming(), registers, link.slave_id)


def _robotiq_socket(link: GripperLink, simulated: SimulatedGripper) -> ConnectionHandler:
    return RobotiqServer(RobotiqState(simulated))


def _robotiq_serial(link: GripperLink, simulated: SimulatedGripper) -> ConnectionHandler:
    return ModbusServer(RtuFraming(), RobotiqRegisters(RobotiqState(simulated)), link.slave_id)


TWINS: dict[tuple[str, str], Callable[[GripperLink, SimulatedGripper], ConnectionHandler]] = {  # by kind and transport
    ("robotiq", "socket"): _robotiq_socket,
    ("robotiq", "tool_serial"): _robotiq_serial,
    ("onrobot", "modbus_tcp"): _onrobot,
    ("http", ""): HttpTwin,
}


def _is_here(address: str, host: str) -> bool:
    if not address:
        return True
    try:
        return socket.gethostbyname(address) == socket.gethostbyname(host)
    except OSError:
        return False
