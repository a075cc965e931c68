"""Shapes from scenes of other programs: MoveIt, Gazebo and MuJoCo, as entries of `keep_out`."""

from planner.scenes.entries import entries_of, with_entries
from planner.scenes.foreign import ForeignScene, ForeignShape, SceneRefused, mesh_at, mesh_text, shape_or_reason
from planner.scenes.reading import read_scene

__all__ = [
    "ForeignScene",
    "ForeignShape",
    "SceneRefused",
    "entries_of",
    "mesh_at",
    "mesh_text",
    "read_scene",
    "shape_or_reason",
    "with_entries",
]
