"""What a controller tells its clients about its arm: model, limits, kinematics with their checksum."""

from __future__ import annotations

from typing import Any

from executor.simulator.interfaces import DenavitHartenberg, RobotFacts
from executor.simulator.physics import ControllerKinematics
from planner.calibration import published_table
from planner.cell import Cell
from planner.robots import Robot

ROBOT_TYPES = {"UR5": 1, "UR10": 2, "UR3": 3, "UR16": 4, "UR20": 7, "UR30": 8}  # source: UR client interfaces
SUB_TYPES = {"CB3": 1, "e-Series": 3}  # chosen; 3 is what an e-Series arm reports
UNCALIBRATED = (0xFFFFFFFF,) * 6  # what URSim reports, whose arm is its model


def robot_facts(cell: Cell, arm: ControllerKinematics) -> RobotFacts:
    """Returns the facts of a cell's arm, whose own table is that of `arm`."""
    robot, nominal = cell.robot, nominal_kinematics(cell.robot)
    calibrated = DenavitHartenberg(_six(arm.theta), _six(arm.a), _six(arm.d), _six(arm.alpha))
    return RobotFacts(
        nominal=nominal,
        calibrated=calibrated,
        checksum=UNCALIBRATED if calibrated == nominal else arm.checksums,
        q_lower=_six(robot.q_lower),
        q_upper=_six(robot.q_upper),
        qd_max=_six(robot.qd_max),
        qdd_max=_six(robot.qdd_max),
        robot_type=ROBOT_TYPES[robot.name.upper().rstrip("E")],
        robot_sub_type=SUB_TYPES[robot.generation],
    )


def nominal_kinematics(robot: Robot) -> DenavitHartenberg:
    """Returns the published parameters of a model."""
    table = published_table(robot)
    return DenavitHartenberg(_six(table.theta), _six(table.a), _six(table.d), _six(table.alpha))


def _six(values: Any) -> Any:
    return tuple(float(value) for value in values)
