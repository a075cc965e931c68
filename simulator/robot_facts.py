"""What a controller tells its clients about its arm: model, limits, kinematics with their checksum."""

from __future__ import annotations

from typing import Any

from planner.calibration import DhTable, published_table
from planner.cell import Cell
from planner.robots import Robot
from simulator.interfaces import DenavitHartenberg, RobotFacts
from simulator.physics import checksums

ROBOT_TYPES = {"UR5": 1, "UR10": 2, "UR3": 3, "UR16": 4, "UR20": 7, "UR30": 8}  # source: UR client interfaces
SUB_TYPES = {"CB3": 1, "e-Series": 3}  # chosen; 3 is what an e-Series arm reports
UNCALIBRATED = (0xFFFFFFFF,) * 6  # what URSim reports, whose arm is its model


def robot_facts(cell: Cell, table: DhTable) -> RobotFacts:
    """Returns the facts of a cell's arm, whose own table is `table`."""
    robot, nominal, calibrated = cell.robot, nominal_kinematics(cell.robot), _told(table)
    return RobotFacts(
        nominal=nominal,
        calibrated=calibrated,
        checksum=UNCALIBRATED if calibrated == nominal else checksums(table),
        q_lower=_six(robot.q_lower),
        q_upper=_six(robot.q_upper),
        qd_max=_six(robot.qd_max),
        qdd_max=_six(robot.qdd_max),
        robot_type=ROBOT_TYPES[robot.name.upper().rstrip("E")],
        robot_sub_type=SUB_TYPES[robot.generation],
    )


def nominal_kinematics(robot: Robot) -> DenavitHartenberg:
    """Returns the published parameters of a model."""
    return _told(published_table(robot))


def _told(table: DhTable) -> DenavitHartenberg:
    return DenavitHartenberg(_six(table.theta), _six(table.a), _six(table.d), _six(table.alpha))


def _six(values: Any) -> Any:
    return tuple(float(value) for value in values)
