"""The ports at which a cell's gripper is reached; adding a twin is a module and a branch here."""

from __future__ import annotations

import socket

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
    return [ServicePort(PORT_NAME, link.port, _server(link, simulated))]


def _server(link: GripperLink, simulated: SimulatedGripper) -> ConnectionHandler:
    if link.kind == "http":
        return HttpTwin(link, simulated)
    if link.kind == "onrobot":
        registers = FingerRegisters(simulated) if link.stroke_m > 0.0 else VacuumRegisters(simulated)
        return ModbusServer(TcpFraming(), registers, link.slave_id)
    state = RobotiqState(simulated)
    if link.transport == "socket":
        return RobotiqServer(state)
    return ModbusServer(RtuFraming(), RobotiqRegisters(state), link.slave_id)


def _is_here(address: str, host: str) -> bool:
    if not address:
        return True
    try:
        return socket.gethostbyname(address) == socket.gethostbyname(host)
    except OSError:
        return False
