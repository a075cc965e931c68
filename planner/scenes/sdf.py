"""Worlds and models in SDF, as Gazebo reads them: the collision shapes of what stands there."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.rotations import pose, quaternion_to_matrix, rotation_vector_to_matrix
from planner.scenes.foreign import ForeignScene, ForeignShape, SceneRefused, mesh_at, numbers_of, shape_or_reason

NUMBERS = {
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "cone": ("radius", "length"),
}


def scene_of_sdf(root: Element, folder: Path) -> ForeignScene:
    """Returns the shapes of an SDF file. Source: http://sdformat.org/spec

    Args:
        root: `<sdf>`.
        folder: of the file.

    Raises:
        SceneRefused: a number in it is none.
    """
    scene = ForeignScene()
    for parent in (root, *root.iterfind("world")):
        _read(parent, np.eye(4), "", folder, scene)
    return scene


def _read(parent: Element, X_WP: Array, prefix: str, folder: Path, scene: ForeignScene) -> None:
    """Reads the models within an element, and what they include."""
    for include in parent.iterfind("include"):
        name = prefix + (include.findtext("name") or include.findtext("uri", "include")).strip()
        scene.left_out.append(f"{name} (included from another file)")
    for model in parent.iterfind("model"):
        name = f"{prefix}{model.get('name', 'model')}"
        X_WM = _placed(model, X_WP, name, scene)
        if X_WM is None:
            continue
        _read(model, X_WM, f"{name}/", folder, scene)
        for link in model.iterfind("link"):
            X_WL = _placed(link, X_WM, name, scene)
            if X_WL is None:
                continue
            for collision in link.iterfind("collision"):
                X = _placed(collision, X_WL, name, scene)
                if X is not None:
                    scene.take(name, _shape(collision, name, X, folder))


def _placed(element: Element, X_WP: Array, name: str, scene: ForeignScene) -> Array | None:
    """Returns the pose of an element in the world; None, and notes it, where it is given in a frame of another name."""
    found = element.find("pose")
    if found is None:
        return X_WP
    if found.get("relative_to"):
        scene.left_out.append(f"{name} (placed relative to {found.get('relative_to')})")
        return None
    words = (found.text or "0 0 0 0 0 0").split()
    if found.get("rotation_format") == "quat_xyzw":
        numbers = numbers_of(words, 7, f"{name}: pose")
        if not any(numbers[3:]):
            raise SceneRefused(f"{name}: a quaternion is zero")
        return X_WP @ pose(numbers[:3], quaternion_to_matrix(numbers[3:]))
    numbers = numbers_of(words, 6, f"{name}: pose")
    angles = np.radians(numbers[3:]) if found.get("degrees") == "true" else numbers[3:]
    return X_WP @ pose(numbers[:3], about_fixed_axes(angles))


def about_fixed_axes(angles: ArrayLike) -> Array:
    """Returns the rotation (3, 3) by angles (3,) [rad] about x, then y, then z of the fixed frame."""
    x, y, z = (rotation_vector_to_matrix(row) for row in np.diag(np.asarray(angles, dtype=np.float64)))
    return z @ y @ x


def _shape(collision: Element, name: str, X: Array, folder: Path) -> ForeignShape | str:
    geometry = collision.find("geometry")
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        return "without geometry"
    if shape.tag == "mesh":
        scale = numbers_of(shape.findtext("scale", "1 1 1").split(), 3, f"{name}: scale")
        return mesh_at(name, X, folder, shape.findtext("uri", "").strip(), scale)
    if shape.tag == "box":
        return shape_or_reason(name, "box", X, numbers_of(shape.findtext("size", "").split(), 3, f"{name}: size"))
    if shape.tag == "plane":
        return "a plane: a floor is surroundings.floor_z_m"
    keys = NUMBERS.get(shape.tag, ())
    numbers = [numbers_of([shape.findtext(key, "").strip()], 1, f"{name}: {key}")[0] for key in keys]
    return shape_or_reason(name, shape.tag, X, numbers)
