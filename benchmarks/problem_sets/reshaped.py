"""Boxes along the axes as other shapes of about their place and size: turned boxes, cylinders, and meshes' covers."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.cell import Solid, cover, shape_of
from planner.rotations import pose, rotation_vector_to_matrix

Vector = NDArray[np.float64]

OTHER_KINDS = ("box", "cylinder", "mesh")
TURN_RAD = 0.5  # at most, about the vertical; a tenth of it about the other axes
MESHES = {
    "ball": lambda: trimesh.creation.icosphere(2, 0.5),
    "pipe": lambda: trimesh.creation.annulus(0.35, 0.5, 1.0),
    "cone": lambda: trimesh.creation.cone(0.5, 1.0),
}


def reshaped(kind: str, box: Solid, rng: np.random.Generator) -> tuple[Solid, ...]:
    """Returns a shape of a kind, of meshes the boxes that cover one, in the middle of a box and about as large."""
    size = box.upper - box.lower
    turn = rotation_vector_to_matrix(rng.uniform(-TURN_RAD, TURN_RAD, 3) * [0.1, 0.1, 1.0])
    X = pose(0.5 * (box.lower + box.upper), turn)
    if kind == "box":
        return (shape_of("box", X, size),)
    if kind == "cylinder":
        along = int(size.argmax())
        across = np.delete(size, along)
        axes = np.roll(np.eye(3), along + 1, axis=1)  # whose last column is the longest edge's
        return (shape_of("cylinder", X @ pose(np.zeros(3), axes), np.array([0.5 * across.mean(), size[along]])),)
    middles, sizes = _covered(str(rng.choice(list(MESHES))))
    return tuple(
        shape_of("box", X @ pose(size * middle, np.eye(3)), size * own)
        for middle, own in zip(middles, sizes, strict=True)
    )


@cache
def _covered(name: str) -> tuple[Vector, Vector]:
    """Returns middles and sizes (k, 3) of the boxes that cover a mesh of size 1; so they do with any other size."""
    mesh = MESHES[name]()
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1.0 / mesh.extents)
    made = cover(np.array(mesh.triangles))
    assert (made.axes == np.eye(3)).all(), name
    return 0.5 * (made.lower + made.upper), made.upper - made.lower
