"""Dynamics of arm, tool and object: joint torques, and the quantities that the arm's own safety system watches."""

from planner.dynamics.inverse_dynamics import (
    Bodies,
    Payload,
    TorqueTerms,
    bodies,
    chain_torques,
    gravity_in_base,
    joint_torques,
    payload_of,
    torque_terms,
)
from planner.dynamics.safety import (
    Use,
    WatchedPoint,
    elbow_points,
    empty_bodies,
    fastest,
    momentum,
    point_velocity,
    safety_use,
    tool_points,
)

__all__ = [
    "Bodies",
    "Payload",
    "TorqueTerms",
    "Use",
    "WatchedPoint",
    "bodies",
    "chain_torques",
    "elbow_points",
    "empty_bodies",
    "fastest",
    "gravity_in_base",
    "joint_torques",
    "momentum",
    "payload_of",
    "point_velocity",
    "safety_use",
    "tool_points",
    "torque_terms",
]
