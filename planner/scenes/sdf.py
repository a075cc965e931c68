"""Worlds and models in SDF, as Gazebo reads them: the collision shapes of what stands there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from planner.arrays import Array
from planner.documents import NotXml, parse_xml, read_file
from planner.errors import FileRefused
from planner.rotations import pose, quaternion_to_matrix, roll_pitch_yaw_to_matrix
from planner.scenes.foreign import (
    SCHEMES,
    ForeignScene,
    ForeignShape,
    SceneRefused,
    mesh_at,
    numbers_of,
    shape_or_reason,
)

INCLUDED_BYTES = 5_000_000  # [byte] of a model's file
WITHIN_MAX = 8  # models within one another
UNREAD = ("actor", "population", "road")  # what else of a world has shapes
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
    frames: dict[str, Array] = {}
    scene.left_out += [f"{prefix}{each.get('name', tag)} ({tag})" for tag in UNREAD for each in parent.iterfind(tag)]
    for include in parent.iterfind("include"):
        name = prefix + (include.findtext("name") or include.findtext("uri", "include")).strip()
        found = _included(include, folder)
        if found is None or prefix.count("/") > WITHIN_MAX:
            scene.left_out.append(f"{name} (included from another file, which is not there)")
        else:
            _read_model(found[0], X_WP, frames, prefix, found[1], scene)
    for model in parent.iterfind("model"):
        _read_model(model, X_WP, frames, prefix, folder, scene)


def _included(include: Element, folder: Path) -> tuple[Element, Path] | None:
    """Returns the model that is included, with the name and the pose that it has here, and its folder."""
    place = include.findtext("uri", "").strip().removeprefix("file://")
    for scheme in SCHEMES:
        place = place.removeprefix(scheme)
    for above in (folder, *folder.resolve().parents):
        for path in (above / place, above / place / "model.sdf", above / "models" / place / "model.sdf"):
            if place and path.is_file():
                try:
                    model = parse_xml(read_file(path, INCLUDED_BYTES)).find("model")
                except (FileRefused, NotXml):
                    return None
                return None if model is None else (_renamed(model, include), path.parent)
    return None


def _renamed(model: Element, include: Element) -> Element:
    if name := include.findtext("name", "").strip():
        model.set("name", name)
    pose_here = include.find("pose")
    if pose_here is not None:
        for own in model.findall("pose"):
            model.remove(own)
        model.append(pose_here)
    return model


def _read_model(
    model: Element, X_WP: Array, frames: dict[str, Array], prefix: str, folder: Path, scene: ForeignScene
) -> None:
    """Reads the shapes of a model, and adds it to the frames (4, 4) of what it stands in, by name."""
    name = f"{prefix}{model.get('name', 'model')}"
    X_WM = _placed(model, X_WP, frames, name, scene)
    if X_WM is None:
        return
    frames[model.get("name", "")] = X_WM
    _read(model, X_WM, f"{name}/", folder, scene)
    if moved := [joint.findtext("child", "") for joint in model.iterfind("joint") if joint.get("type") != "fixed"]:
        scene.notes.append(f"{name}: joints move {', '.join(moved)}; shapes are taken where the file has them")
    within = {"__model__": X_WM}
    for link in model.iterfind("link"):
        X_WL = _placed(link, X_WM, within, name, scene)
        if X_WL is None:
            continue
        within[link.get("name", "")] = X_WL
        if link.find("collision") is None and link.find("visual") is not None:
            scene.left_out.append(f"{name} (only drawn)")
        for collision in link.iterfind("collision"):
            X = _placed(collision, X_WL, within, name, scene)
            if X is not None:
                scene.take(name, _shape(collision, name, X, folder))


def _placed(element: Element, X_WP: Array, frames: Mapping[str, Array], name: str, scene: ForeignScene) -> Array | None:
    """Returns the pose of an element in the world; None, and notes it, where it is given in a frame not known yet."""
    found = element.find("pose")
    if found is None:
        return X_WP
    if other := found.get("relative_to"):
        if other not in frames:
            scene.left_out.append(f"{name} (placed relative to {other})")
            return None
        X_WP = frames[other]
    words = (found.text or "0 0 0 0 0 0").split()
    if found.get("rotation_format") == "quat_xyzw":
        numbers = numbers_of(words, 7, f"{name}: pose")
        if not any(numbers[3:]):
            raise SceneRefused(f"{name}: a quaternion is zero")
        return X_WP @ pose(numbers[:3], quaternion_to_matrix(numbers[3:]))
    numbers = numbers_of(words, 6, f"{name}: pose")
    angles = np.radians(numbers[3:]) if found.get("degrees") == "true" else numbers[3:]
    return X_WP @ pose(numbers[:3], roll_pitch_yaw_to_matrix(*angles))


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
