"""Geometry of arm, tool and object: state, capsules, distances, what can collide, flights, where an object fits."""

from planner.geometry.arcs import Arcs
from planner.geometry.body import BodyModel, ToolState, body_model, held_object, tool_pose, tool_state, twist_in_base
from planner.geometry.capsules import arm_capsules, body_capsules, capsule_endpoints, levers
from planner.geometry.distances import (
    POINT_M2,
    pair_distances,
    point_segment_distance,
    segment_segment_distance,
    segment_shape_distance,
    shape_distances,
)
from planner.geometry.misfit import Misfit, misfit
from planner.geometry.self_collision import (
    SELF_CLEARANCE_M,
    NeverClear,
    barriers,
    never_clear,
    object_pairs,
    passable,
    pierced,
    self_collision_pairs,
)
from planner.geometry.surfaces import LEVEL_M, Surface, footprint, landing_surfaces

__all__ = [
    "LEVEL_M",
    "POINT_M2",
    "SELF_CLEARANCE_M",
    "Arcs",
    "BodyModel",
    "Misfit",
    "NeverClear",
    "Surface",
    "ToolState",
    "arm_capsules",
    "barriers",
    "body_capsules",
    "body_model",
    "capsule_endpoints",
    "footprint",
    "held_object",
    "landing_surfaces",
    "levers",
    "misfit",
    "never_clear",
    "object_pairs",
    "pair_distances",
    "passable",
    "pierced",
    "point_segment_distance",
    "segment_segment_distance",
    "segment_shape_distance",
    "self_collision_pairs",
    "shape_distances",
    "tool_pose",
    "tool_state",
    "twist_in_base",
]
