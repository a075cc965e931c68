"""The daemon's own view of the robot: live state, dashboard, and the simulator's control port."""

from executor.robot import simulator_client
from executor.robot.dashboard import DashboardClient
from executor.robot.monitor import Monitor, RobotState, RtdeReceiver, receive_timestamps
from executor.robot.session import RobotSession, robot_document

__all__ = [
    "DashboardClient",
    "Monitor",
    "RobotSession",
    "RobotState",
    "RtdeReceiver",
    "receive_timestamps",
    "robot_document",
    "simulator_client",
]
