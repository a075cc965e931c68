"""The physical side: arm with its lag, outputs, gripper, objects in flight. No program, no socket."""

from executor.simulator.physics import kinematics
from executor.simulator.physics.arm import Arm, MotionConflict
from executor.simulator.physics.controller_kinematics import checksums
from executor.simulator.physics.dynamics import JointTorques
from executor.simulator.physics.kinematics import Transform
from executor.simulator.physics.obstacles import RoundBin
from executor.simulator.physics.workcell import Workcell

__all__ = [
    "Arm",
    "checksums",
    "JointTorques",
    "MotionConflict",
    "RoundBin",
    "Transform",
    "Workcell",
    "kinematics",
]
