"""The ports at which a cell's gripper is reached.

The module that is named after a kind has its function `twin`: adding one is a module.
"""

from __future__ import annotations

import socket
from importlib import import_module

from planner.cell import Gripper
from simulator.interfaces import ServicePort
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
    of_kind = import_module(f"simulator.grippers.{link.kind}")
    return [ServicePort(PORT_NAME, link.port, of_kind.twin(link, simulated))]


def _is_here(address: str, host: str) -> bool:
    if not address:
        return True
    try:
        return socket.gethostbyname(address) == socket.gethostbyname(host)
    except OSError:
        return False
