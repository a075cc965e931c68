"""Dynamics of arm, tool and object: joint torques, and the quantities that the arm's own safety system watches."""

from planner.dynamics.inverse_dynamics import (
    Payload,
    TorqueTerms,
    bodies,
    gravity_in_base,
    joint_torques,
    payload_of,
    torque_terms,
)
from planner.dynamics.safety import (
    WatchedPoint,
    elbow_points,
    empty_bodies,
    fastest,
    loaded_bodies,
    momentum,
    safety_use,
    tool_points,
)

__all__ = [
    "Payload",
    "TorqueTerms",
    "WatchedPoint",
    "bodies",
    "elbow_points",
    "empty_bodies",
    "fastest",
    "gravity_in_base",
    "joint_torques",
    "loaded_bodies",
    "momentum",
    "payload_of",
    "safety_use",
    "tool_points",
    "torque_terms",
]
