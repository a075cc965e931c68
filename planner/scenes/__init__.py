"""Scenes of other programs, such as MoveIt and MuJoCo, and scans: as entries of `keep_out`; and a cell for them."""

from planner.scenes.entries import entries_of, not_there, with_entries
from planner.scenes.export import mjcf_of, urdf_of
from planner.scenes.foreign import ForeignScene, ForeignShape, SceneRefused, mesh_at, mesh_text, shape_or_reason
from planner.scenes.reading import read_scene
from planner.scenes.scan import MILLIMETRE, Scan, points_ply, read_points, scanned

__all__ = [
    "MILLIMETRE",
    "ForeignScene",
    "ForeignShape",
    "Scan",
    "SceneRefused",
    "entries_of",
    "mesh_at",
    "mesh_text",
    "mjcf_of",
    "not_there",
    "points_ply",
    "read_points",
    "read_scene",
    "scanned",
    "shape_or_reason",
    "urdf_of",
    "with_entries",
]
