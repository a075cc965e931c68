"""The robot state message of the primary and secondary interfaces, sub-package by sub-package.

Source: Universal Robots, "Primary and secondary interfaces", "Robot state message": int32 size, uint8 type 16, then
sub-packages of int32 size, uint8 type and fields; big-endian. The sub-packages that UR documents as its own (9, 10)
are left out.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.calibration import DhTable, published_table
from planner.robots import Robot

ROBOT_STATE = 16
HEAD = struct.Struct(">iB")
PROTECTIVE_BIT = 1 << 2
EMERGENCY_BITS = 1 << 5 | 1 << 6 | 1 << 7  # safety_status_bits; source: RTDE guide
PLAYING = 2
PAUSED = 4  # runtime_state; source: RTDE guide
TOOL_BAUD = 115200
TOOL_STOP_BITS = 1
TOOL_RX_IDLE = 1.5
TOOL_TX_IDLE = 3.5  # source: URScript manual, tool defaults
JOINT_DEFAULTS = (1.05, 1.40)  # [rad/s, rad/s^2] source: URScript manual, movej
TOOL_DEFAULTS = (0.25, 1.20)  # [m/s, m/s^2] source: URScript manual, movel
EQ_RADIUS_M = 0.25  # chosen: the lever of a rotation; UR's own use
MASTERBOARD_VERSION = 6
CONTROLLER_BOX = 4  # chosen: what an e-Series control box reports
SUB_TYPES = {"CB3": 1, "e-Series": 3}  # chosen; 3 is what an e-Series arm reports

Values = Mapping[str, Sequence[float]]


@dataclass(frozen=True, eq=False)
class RobotFacts:
    """What does not change while the controller runs.

    Attributes:
        robot: model and limits.
        table: kinematics of this very arm.
        checksums: of the calibration, one number for each of the six joints.
    """

    robot: Robot
    table: DhTable
    checksums: tuple[int, ...]


def _package(kind: int, form: str, *numbers: float) -> bytes:
    body = struct.pack(f">{form}", *numbers)
    return HEAD.pack(HEAD.size + len(body), kind) + body


def _robot_mode(v: Values) -> bytes:
    bits = int(v["safety_status_bits"][0])
    runtime = v["runtime_state"][0]
    powered = bool(int(v["robot_status_bits"][0]) & 1)
    emergency = bool(bits & EMERGENCY_BITS)
    protective = bool(bits & PROTECTIVE_BIT)
    flags = (True, True, powered, emergency, protective, runtime == PLAYING, runtime == PAUSED)
    mode = int(v["robot_mode"][0])
    fraction = v["target_speed_fraction"][0]
    scaling = v["speed_scaling"][0]
    microseconds = round(v["timestamp"][0] * 1e6)
    return _package(0, "Q7?BBdddB", microseconds, *flags, mode, 0, fraction, scaling, 1.0, 0)


def _joints(v: Values) -> bytes:
    names = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage", "joint_temperatures")
    numbers: list[float] = []
    for i in range(6):
        numbers += [*(v[name][i] for name in names), 0.0, int(v["joint_mode"][i])]
    return _package(1, "dddffffB" * 6, *numbers)


def _tool(v: Values) -> bytes:
    inputs = (v["tool_analog_input0"][0], v["tool_analog_input1"][0])
    supply = (v["actual_robot_voltage"][0], int(v["tool_output_voltage"][0]), v["tool_output_current"][0])
    return _package(2, "BBddfBffB", 1, 1, *inputs, *supply, v["tool_temperature"][0], int(v["tool_mode"][0]))


def _masterboard(v: Values) -> bytes:
    bits = (int(v["actual_digital_input_bits"][0]), int(v["actual_digital_output_bits"][0]))
    inputs = (v["standard_analog_input0"][0], v["standard_analog_input1"][0])
    outputs = (v["standard_analog_output0"][0], v["standard_analog_output1"][0])
    supply = (v["actual_robot_voltage"][0], v["actual_robot_current"][0], v["io_current"][0])
    mode = int(v["safety_mode"][0])
    numbers = (*bits, 1, 1, *inputs, 1, 1, *outputs, v["tool_temperature"][0], *supply, mode, 0, 0, 0, 0, 0, 0)
    return _package(3, "IIBBddBBddffffBBBIBBB", *numbers)


def _cartesian(v: Values) -> bytes:
    return _package(4, "12d", *v["actual_TCP_pose"], *v["tcp_offset"])


def _kinematics(facts: RobotFacts) -> bytes:
    k = facts.table
    return _package(5, "6I24dI", *facts.checksums, *k.theta, *k.a, *k.d, *k.alpha, 0)


def _configuration(facts: RobotFacts) -> bytes:
    robot = facts.robot
    limits = np.ravel([robot.q_lower, robot.q_upper], order="F")  # lower and upper of the first joint, of the second …
    motion = np.ravel([robot.qd_max, robot.qdd_max], order="F")
    k = published_table(robot)
    defaults = (*JOINT_DEFAULTS, *TOOL_DEFAULTS, EQ_RADIUS_M)
    model = (robot.type_code, SUB_TYPES[robot.generation])
    numbers = (*limits, *motion, *defaults, *k.a, *k.d, *k.alpha, *k.theta)
    return _package(6, "53d4i", *numbers, MASTERBOARD_VERSION, CONTROLLER_BOX, *model)


def _force_mode(v: Values) -> bytes:
    return _package(7, "7d", *v["actual_TCP_force"], 0.0)


def _additional(v: Values) -> bytes:
    return _package(8, "BBBB", 0, 1, 0, 0)  # no button pressed, freedrive allowed


def _tool_communication(v: Values) -> bytes:
    return _package(11, "BiiIff", 0, TOOL_BAUD, 0, TOOL_STOP_BITS, TOOL_RX_IDLE, TOOL_TX_IDLE)


def _tool_mode(v: Values) -> bytes:
    modes = (v["tool_output_mode"][0], v["tool_digital_output0_mode"][0], v["tool_digital_output1_mode"][0])
    return _package(12, "BBB", *map(int, modes))


CHANGING = (_robot_mode, _joints, _cartesian, _masterboard, _tool, _force_mode, _additional)
E_SERIES = (_tool_communication, _tool_mode)  # CB3 has no communication over the tool's connector


def robot_state(values: Values, facts: RobotFacts | None, e_series: bool) -> bytes:
    """Returns the robot state message.

    Args:
        values: RTDE's output variables -> their numbers.
        facts: kinematics and configuration, which the first message on a connection carries; None to leave them out.
        e_series: whether the controller is an e-Series.
    """
    packages = [build(values) for build in (*CHANGING, *(E_SERIES if e_series else ()))]
    if facts is not None:
        packages += [_kinematics(facts), _configuration(facts)]
    body = b"".join(packages)
    return HEAD.pack(HEAD.size + len(body), ROBOT_STATE) + body
