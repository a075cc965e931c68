"""Kinematic calibration: the chain of one particular arm, as its factory measured it.

Read from the controller's Denavit-Hartenberg table or from a file in the format of Universal Robots' ROS driver.
"""

from planner.calibration.chain import (
    ImplausibleChain,
    calibrated,
    fixed_transforms,
    transforms_of_links,
    transforms_of_table,
)
from planner.calibration.dh_table import DhTable, published_table, table_of
from planner.calibration.driver_file import CalibrationFile, calibration_text, parse_calibration

__all__ = [
    "CalibrationFile",
    "DhTable",
    "ImplausibleChain",
    "calibrated",
    "calibration_text",
    "fixed_transforms",
    "parse_calibration",
    "published_table",
    "table_of",
    "transforms_of_links",
    "transforms_of_table",
]
