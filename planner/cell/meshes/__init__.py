"""What cells make of meshes and point clouds: boxes, a shape that encloses one, or the walls of a room."""

from planner.cell.meshes.boxes import MeshCover, cover
from planner.cell.meshes.files import (
    CELL_M,
    ENCLOSED,
    MESH_BYTES,
    MESH_KINDS,
    WALLED,
    EnclosedMesh,
    cover_in,
    cover_key,
    cover_keys,
    covers_of,
    file_of,
    mesh_hashes,
    point_cloud,
    shape_in,
    walls_in,
)
from planner.cell.meshes.points import full_cells

__all__ = [
    "CELL_M",
    "ENCLOSED",
    "MESH_BYTES",
    "MESH_KINDS",
    "WALLED",
    "EnclosedMesh",
    "MeshCover",
    "cover",
    "cover_in",
    "cover_key",
    "cover_keys",
    "covers_of",
    "file_of",
    "full_cells",
    "mesh_hashes",
    "point_cloud",
    "shape_in",
    "walls_in",
]
