"""The physical side: arm with its lag, outputs, gripper, objects in flight. No program, no socket."""

from executor.simulator.physics import kinematics
from executor.simulator.physics.arm import Arm, MotionConflict
from executor.simulator.physics.dynamics import JointTorques
from executor.simulator.physics.kinematics import KinematicChain, Transform
from executor.simulator.physics.outputs import OUTPUT_KINDS, Outputs
from executor.simulator.physics.workcell import Workcell

__all__ = [
    "OUTPUT_KINDS",
    "JointTorques",
    "KinematicChain",
    "MotionConflict",
    "Outputs",
    "Arm",
    "Transform",
    "Workcell",
    "kinematics",
]
