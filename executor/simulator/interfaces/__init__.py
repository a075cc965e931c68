"""The services of the controller on the network. Registers and actions are handed in; nothing here knows an arm."""

from executor.simulator.interfaces.connections import Connection, ConnectionHandler
from executor.simulator.interfaces.control_server import BadRequest, ControlServer, Document
from executor.simulator.interfaces.dashboard_server import DashboardServer
from executor.simulator.interfaces.network import Network, ServicePort
from executor.simulator.interfaces.primary_server import PrimaryServer
from executor.simulator.interfaces.realtime_server import RealtimeServer
from executor.simulator.interfaces.recipes import InputValues
from executor.simulator.interfaces.robot_state import DenavitHartenberg, RobotFacts
from executor.simulator.interfaces.rtde_server import RtdeServer
from executor.simulator.interfaces.script_server import Commands, ScriptServer
from executor.simulator.interfaces.variables import OUTPUT_TYPES, WIDTH

__all__ = [
    "OUTPUT_TYPES",
    "WIDTH",
    "BadRequest",
    "Commands",
    "Connection",
    "ConnectionHandler",
    "ControlServer",
    "DashboardServer",
    "DenavitHartenberg",
    "Document",
    "InputValues",
    "Network",
    "PrimaryServer",
    "RealtimeServer",
    "RobotFacts",
    "RtdeServer",
    "ScriptServer",
    "ServicePort",
]
