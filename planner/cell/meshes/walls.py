"""The walls of a room that is a convex mesh: boxes whose common part it is.

Each flat side of the mesh is a side of a box about all of it. The largest side that is none yet is the next one's top;
what it has perpendicular to that gives the box's other axes, so that a cuboid is one box. The sides of a box are moved
inwards to the lowest corner of the faces that lie in them, so that what lies within all boxes is within the mesh: a way
out of it leads through a face, and there through a side.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.cell.meshes.boxes import BOXES_MAX, MeshCover

EVEN = 1e-4  # [-] of the longest side: corners in single precision, and planes through thin faces, are off by less
SQUARE = 1e-6  # [-] cosine between perpendicular faces, as they are written
AREA_MIN = 1e-12  # [-] of the longest side's square: a smaller face has no plane, and nothing gets out through it


def walls(triangles: Array) -> list[MeshCover]:
    """Returns the boxes, one a cover, whose common part a mesh is, to `EVEN` of its longest side.

    Args:
        triangles: corners of its faces (n, 3, 3), finite, a closed surface.

    Raises:
        ValueError: it is not convex, or has too many sides.
    """
    corners = np.unique(triangles.reshape(-1, 3), axis=0)
    longest = float(np.ptp(corners, axis=0).max())
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(across, axis=1)
    largest = np.argsort(-areas, kind="stable")
    left = largest[areas[largest] > AREA_MIN * longest**2]
    found: list[MeshCover] = []
    while len(left):
        if len(found) == BOXES_MAX:
            raise ValueError(
                f"has more sides than {BOXES_MAX} boxes have: a round room is a cylinder, sphere or capsule"
            )
        normals = across[left] / areas[left, None]
        axes = _axes(normals, triangles[left[0]], corners)
        sides = np.concatenate([-axes.T, axes.T])
        reach = (corners @ sides.T).max(axis=0)
        lowest = (triangles[left] @ sides.T).min(axis=1)
        is_in = reach - lowest <= EVEN * longest
        if not is_in[0, 5]:
            beyond = float(reach[5] - lowest[0, 5])
            raise ValueError(
                f"is not convex: it reaches {beyond:.3g} beyond one of its faces, in the unit of the file, of "
                f"{longest:.3g} that it is long; give its walls as keep_out"
            )
        ends = np.where(is_in, lowest, reach).min(axis=0)
        if (ends[:3] + ends[3:] <= 0.0).any():
            raise ValueError("is flat: there is no room in it")
        found.append(MeshCover(axes, -ends[None, :3], ends[None, 3:], 0.0))
        left = left[~is_in.any(axis=1)]
    return found


def _axes(normals: Array, face: Array, corners: Array) -> Array:
    """Returns the axes (3, 3), one a column, of a box with the first of the faces above: right-handed.

    Args:
        normals: of the faces that are no sides yet (n, 3).
        face: corners of the first (3, 3).
        corners: of the mesh (m, 3).
    """
    heights = (corners - face[0]) @ normals[0]
    z = normals[0] * (1.0 if heights.max() <= -heights.min() else -1.0)  # out of the mesh, however it is wound
    is_square = np.abs(normals @ z) < SQUARE
    x = normals[int(is_square.argmax())] if is_square.any() else face[1] - face[0]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
