"""The services of the controller on the network. Registers and actions are handed in; nothing here knows an arm."""

from simulator.interfaces.camera_server import CameraServer
from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.interfaces.control_server import BadRequest, ControlServer, Document
from simulator.interfaces.dashboard_server import DashboardServer
from simulator.interfaces.interpreter_server import InterpreterServer
from simulator.interfaces.network import Network, ServicePort
from simulator.interfaces.primary_server import PrimaryServer
from simulator.interfaces.realtime_server import RealtimeServer
from simulator.interfaces.recipes import InputValues
from simulator.interfaces.robot_api_server import RobotApiServer
from simulator.interfaces.robot_state import RobotFacts
from simulator.interfaces.rtde_server import RtdeServer
from simulator.interfaces.script_server import Commands, ScriptServer
from simulator.interfaces.variables import OUTPUT_TYPES, WIDTH

__all__ = [
    "OUTPUT_TYPES",
    "WIDTH",
    "BadRequest",
    "CameraServer",
    "Commands",
    "Connection",
    "ConnectionHandler",
    "ControlServer",
    "DashboardServer",
    "Document",
    "InputValues",
    "InterpreterServer",
    "Network",
    "PrimaryServer",
    "RealtimeServer",
    "RobotApiServer",
    "RobotFacts",
    "RtdeServer",
    "ScriptServer",
    "ServicePort",
]
