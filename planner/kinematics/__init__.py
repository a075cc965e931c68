"""Kinematics of the arms, over many samples at once: poses, Jacobians, inverse kinematics, singularities."""

from planner.kinematics.chain_difference import ChainDifference, chain_difference
from planner.kinematics.differential_kinematics import forward_velocity, inverse_velocity
from planner.kinematics.forward_kinematics import (
    analytical_jacobian,
    flange_poses,
    forward,
    jacobian,
    jacobian_dot_qd,
    link_poses,
    point_motion,
    tcp_acceleration,
)
from planner.kinematics.inverse_kinematics import inverse, inverse_branches
from planner.kinematics.link_motion import LinkMotion, accumulate, cross, dot
from planner.kinematics.singularities import (
    SINGULARITIES,
    manipulability,
    signed_singularity_distances,
    singularity_distances,
    smallest_singular_value,
)

__all__ = [
    "SINGULARITIES",
    "ChainDifference",
    "LinkMotion",
    "accumulate",
    "analytical_jacobian",
    "chain_difference",
    "cross",
    "dot",
    "flange_poses",
    "forward",
    "forward_velocity",
    "inverse",
    "inverse_branches",
    "inverse_velocity",
    "jacobian",
    "jacobian_dot_qd",
    "link_poses",
    "manipulability",
    "point_motion",
    "signed_singularity_distances",
    "singularity_distances",
    "smallest_singular_value",
    "tcp_acceleration",
]
