"""The daemon's own view of the robot: live state, operation, stops, and the simulator's control port."""

from executor.robot import simulator_client
from executor.robot.console import PENDANT, Console
from executor.robot.dashboard import DashboardClient
from executor.robot.found import FoundRobot, find_robot
from executor.robot.gripper_hold import GripperHold
from executor.robot.kinematics_client import KinematicsInfo, read_kinematics
from executor.robot.operation import ActionRefused, ControlMode
from executor.robot.primary import ProgramWatch, stop_program
from executor.robot.session import (
    OWNER_INPUT,
    RATE_HZ,
    Monitor,
    RobotSession,
    RobotState,
    receive_timestamps,
    robot_document,
    set_outputs,
)

__all__ = [
    "OWNER_INPUT",
    "PENDANT",
    "RATE_HZ",
    "ActionRefused",
    "Console",
    "ControlMode",
    "DashboardClient",
    "FoundRobot",
    "GripperHold",
    "KinematicsInfo",
    "Monitor",
    "ProgramWatch",
    "RobotSession",
    "RobotState",
    "find_robot",
    "read_kinematics",
    "receive_timestamps",
    "robot_document",
    "set_outputs",
    "simulator_client",
    "stop_program",
]
