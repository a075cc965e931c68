"""The services of the controller on the network. Registers and actions are handed in; nothing here knows an arm."""

from executor.simulator.interfaces.connections import Connection, ConnectionHandler
from executor.simulator.interfaces.control_server import BadRequest, ControlServer, Document
from executor.simulator.interfaces.dashboard_server import DashboardServer
from executor.simulator.interfaces.network import Network, ServicePort
from executor.simulator.interfaces.recipes import InputValues
from executor.simulator.interfaces.rtde_server import RtdeServer
from executor.simulator.interfaces.script_server import ScriptServer
from executor.simulator.interfaces.variables import OUTPUT_TYPES, WIDTH

__all__ = [
    "OUTPUT_TYPES",
    "WIDTH",
    "BadRequest",
    "Connection",
    "ConnectionHandler",
    "ControlServer",
    "DashboardServer",
    "Document",
    "InputValues",
    "Network",
    "RtdeServer",
    "ScriptServer",
    "ServicePort",
]
