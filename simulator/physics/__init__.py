"""The physical side: arm with its lag, outputs, gripper, objects in flight. No program, no socket."""

from simulator.physics import kinematics
from simulator.physics.arm import Arm, MotionConflict
from simulator.physics.controller_kinematics import told_checksums
from simulator.physics.gripper import SimulatedGripper
from simulator.physics.kinematics import Transform
from simulator.physics.obstacles import RoundBin
from simulator.physics.workcell import Workcell

__all__ = [
    "Arm",
    "MotionConflict",
    "RoundBin",
    "SimulatedGripper",
    "Transform",
    "Workcell",
    "kinematics",
    "told_checksums",
]
