"""Shapes of arm and tool as capsules, distances between them, and which of them can meet."""

from planner.geometry.barriers import Barrier, barriers, passable
from planner.geometry.capsules import Capsule, arm_capsules, body_capsules, capsule_endpoints
from planner.geometry.collisions import SELF_CLEARANCE_M, self_collision_pairs
from planner.geometry.distances import segment_box_distance, segment_segment_distance
from planner.geometry.tool import ToolState, tool_pose, tool_state

__all__ = [
    "SELF_CLEARANCE_M",
    "Barrier",
    "Capsule",
    "ToolState",
    "arm_capsules",
    "barriers",
    "body_capsules",
    "capsule_endpoints",
    "passable",
    "segment_box_distance",
    "segment_segment_distance",
    "self_collision_pairs",
    "tool_pose",
    "tool_state",
]
