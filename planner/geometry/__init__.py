"""Geometry of arm, tool and held object: the tool's state, capsules, their distances, and which can collide."""

from planner.geometry.body import BodyModel, Clearances, body_model
from planner.geometry.capsules import Capsule, arm_capsules, body_capsules, capsule_endpoints, levers
from planner.geometry.distances import segment_box_distance, segment_segment_distance
from planner.geometry.self_collision import SELF_CLEARANCE_M, Barrier, barriers, passable, self_collision_pairs
from planner.geometry.tool import ToolState, tool_pose, tool_state

__all__ = [
    "SELF_CLEARANCE_M",
    "Barrier",
    "BodyModel",
    "Capsule",
    "Clearances",
    "ToolState",
    "arm_capsules",
    "barriers",
    "body_capsules",
    "body_model",
    "capsule_endpoints",
    "levers",
    "passable",
    "segment_box_distance",
    "segment_segment_distance",
    "self_collision_pairs",
    "tool_pose",
    "tool_state",
]
