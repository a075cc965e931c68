"""The cell: one robot station, read from a checked TOML file.

All facts about a site are in its cell file; the arm's own data are in `planner.robots`.
"""

from planner.cell.arm_data import completed_arm
from planner.cell.changes import cell_of_keys
from planner.cell.faults import mended_cell
from planner.cell.fields import choice, merge_defaults, number, vector
from planner.cell.file import DEFAULTS, NAME_PATTERN, cell_of, checked_polyscope, load_cell, parse_cell
from planner.cell.keep_out import is_reserved, tool_shapes
from planner.cell.limits import SAFETY_LIMITS, STANDING_RAD, Limits, Safety
from planner.cell.meshes import (
    CELL_M,
    MESH_BYTES,
    MESH_KINDS,
    WALLED,
    cover,
    cover_in,
    cover_key,
    full_cells,
    mesh_hashes,
    point_cloud,
    walls_in,
)
from planner.cell.model import (
    CONTACT_M,
    FARTHEST_M,
    AllowedContact,
    Cell,
    DigitalOutput,
    Gripper,
    MountedGripper,
    Surroundings,
    ToolCapsule,
)
from planner.cell.shapes import Box, Solid, nearest_on_cores, shape_of
from planner.cell.source import CellSource, calibration_path, mesh_paths, read_source, source_of
from planner.cell.thrown_object import ThrownBody, ThrownObject, enclosed_object

__all__ = [
    "CELL_M",
    "CONTACT_M",
    "DEFAULTS",
    "FARTHEST_M",
    "MESH_BYTES",
    "MESH_KINDS",
    "NAME_PATTERN",
    "SAFETY_LIMITS",
    "STANDING_RAD",
    "Box",
    "Cell",
    "CellSource",
    "AllowedContact",
    "DigitalOutput",
    "Gripper",
    "Limits",
    "MountedGripper",
    "Safety",
    "Solid",
    "Surroundings",
    "ThrownBody",
    "ThrownObject",
    "ToolCapsule",
    "calibration_path",
    "cell_of",
    "cell_of_keys",
    "checked_polyscope",
    "choice",
    "completed_arm",
    "cover",
    "cover_in",
    "cover_key",
    "enclosed_object",
    "full_cells",
    "is_reserved",
    "load_cell",
    "mesh_hashes",
    "mesh_paths",
    "mended_cell",
    "merge_defaults",
    "nearest_on_cores",
    "number",
    "parse_cell",
    "point_cloud",
    "read_source",
    "shape_of",
    "source_of",
    "tool_shapes",
    "vector",
    "WALLED",
    "walls_in",
]
