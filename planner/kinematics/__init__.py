"""Kinematics of the arms: poses, Jacobians, velocities, singularities, inverse kinematics; all over many samples."""

from planner.kinematics.branches import InverseKinematics, inverse, inverse_branches
from planner.kinematics.chain import (
    analytical_jacobian,
    forward,
    jacobian,
    jacobian_dot_qd,
    link_poses,
    tcp_acceleration,
)
from planner.kinematics.motion import LinkMotion
from planner.kinematics.singularities import (
    SINGULARITIES,
    SingularityDistances,
    manipulability,
    signed_singularity_distances,
    singularity_distances,
    smallest_singular_value,
)
from planner.kinematics.velocities import forward_velocity, inverse_velocity

__all__ = [
    "SINGULARITIES",
    "InverseKinematics",
    "LinkMotion",
    "SingularityDistances",
    "analytical_jacobian",
    "forward",
    "forward_velocity",
    "inverse",
    "inverse_branches",
    "inverse_velocity",
    "jacobian",
    "jacobian_dot_qd",
    "link_poses",
    "manipulability",
    "signed_singularity_distances",
    "singularity_distances",
    "smallest_singular_value",
    "tcp_acceleration",
]
