"""The meshes of a drawn cell as coal sees them: the faces of the files, not the boxes that cover them."""

from __future__ import annotations

import io

import coal
import numpy as np
import pinocchio as pin
import trimesh

from audit.judge import Obstacle, coal_mesh
from audit.problems.cell_file import CellFiles


def meshes_of(files: CellFiles) -> tuple[Obstacle, ...]:
    """Returns the keep-out meshes of a cell, each with what it is kept from beyond the cell's clearance [m]."""
    around = files.keys["surroundings"]
    found = []
    for number, entry in enumerate(around.get("keep_out", [])):
        if entry.get("shape") != "mesh":
            continue
        mesh = trimesh.load_mesh(io.BytesIO(files.beside[entry["file"]]), file_type="stl")
        R = pin.exp3(np.array(entry["pose"]["rotation_vector_rad"]))
        place = coal.Transform3s(R, np.array(entry["pose"]["position_m"]))
        further = entry.get("clearance_m", around["clearance_m"]) - around["clearance_m"]
        found.append((coal_mesh(mesh), place, further, f"mesh {number} itself"))
    return tuple(found)
