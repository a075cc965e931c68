"""Scenes of MoveIt: the text that RViz exports (`.scene`), and planning-scene messages as YAML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.rotations import pose, quaternion_to_matrix
from planner.scenes.foreign import (
    TEXT_MAX,
    ForeignScene,
    ForeignShape,
    SceneRefused,
    mesh_at,
    mesh_text,
    numbers_of,
    shape_or_reason,
)

# source: moveit_msgs, shape_msgs/SolidPrimitive: numbers of the types, and the order of their dimensions
TYPES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
# source: geometric_shapes, shape_operations.cpp, `saveAsText`: how many numbers follow the name of a shape
TEXT_NUMBERS = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2, "plane": 4}
SHAPES_MAX = 2000  # of a file


def read_scene_text(text: str) -> ForeignScene:
    """Returns the shapes of a `.scene` file, of either format.

    Source: moveit_core, planning_scene.cpp, `saveGeometryToStream`.

    Raises:
        SceneRefused: it is none.
    """
    lines = iter([line.strip() for line in text.splitlines() if line.strip()][1:])
    scene = ForeignScene()
    try:
        for line in lines:
            if line == ".":
                return scene
            if not line.startswith("*"):
                raise SceneRefused(f"has {line[:TEXT_MAX]!r} where '* NAME' of the next object begins")
            _read_object(line[1:].strip(), lines, scene)
    except StopIteration:
        pass
    raise SceneRefused("ends before the '.' that ends a scene")


def _read_object(name: str, lines: Iterator[str], scene: ForeignScene) -> None:
    first = next(lines)
    X = np.eye(4)
    if len(first.split()) == 3:  # since MoveIt 1.1 an object has a pose of its own, and subframes
        X = _text_pose(first, next(lines), name)
    has_pose = len(first.split()) == 3
    count = int(numbers_of([next(lines)] if has_pose else [first], 1, name)[0])
    for _ in range(count):
        if len(scene.shapes) >= SHAPES_MAX:
            raise SceneRefused(f"has more than {SHAPES_MAX} shapes")
        kind = next(lines)
        mesh = _text_mesh(lines, name) if kind == "mesh" else None
        numbers = [] if mesh else numbers_of(next(lines).split(), TEXT_NUMBERS.get(kind, 0), f"{name}: {kind}")
        placed = X @ _text_pose(next(lines), next(lines), name)
        next(lines)  # its colour
        if mesh:
            scene.take(name, ForeignShape(name, "mesh", placed, {"scale": 1.0}, mesh))
        else:
            scene.take(name, shape_or_reason(name, kind, placed, numbers))
    if has_pose:
        for _ in range(int(numbers_of([next(lines)], 1, name)[0])):
            for _ in range(3):
                next(lines)


def _text_mesh(lines: Iterator[str], name: str) -> tuple[bytes, str]:
    corners, triangles = map(int, numbers_of(next(lines).split(), 2, f"{name}: mesh"))
    vertices = [numbers_of(next(lines).split(), 3, f"{name}: vertex") for _ in range(corners)]
    faces = [[int(i) for i in numbers_of(next(lines).split(), 3, f"{name}: triangle")] for _ in range(triangles)]
    return mesh_text(np.array(vertices), faces)


def _text_pose(position: str, quaternion: str, name: str) -> Array:
    return _pose(numbers_of(position.split(), 3, name), numbers_of(quaternion.split(), 4, name), name)


def _pose(position: list[float], quaternion: list[float], name: str) -> Array:
    if not np.linalg.norm(quaternion) > 0.0:
        raise SceneRefused(f"{name}: a quaternion is zero")
    return pose(position, quaternion_to_matrix(quaternion))


def scene_of_message(document: Any, folder: Path) -> ForeignScene:
    """Returns the shapes of a planning-scene message, or of a list of collision objects.

    Args:
        document: the message.
        folder: of the file.

    Raises:
        SceneRefused: it is none.
    """
    world = document.get("world", document) if isinstance(document, Mapping) else None
    objects = world.get("collision_objects") if isinstance(world, Mapping) else document
    if not isinstance(objects, list) or not all(isinstance(each, Mapping) for each in objects):
        raise SceneRefused("has no list of collision_objects")
    scene = ForeignScene()
    frames = {}
    for each in objects:
        name = str(each.get("id", "object"))
        frame = _mapping(each.get("header")).get("frame_id", "world")
        frames[str(frame)] = name
        X = _message_pose(each["pose"], name) if "pose" in each else np.eye(4)
        for found in _shapes(each, name, X, folder):
            scene.take(name, found)
        if len(scene.shapes) > SHAPES_MAX:
            raise SceneRefused(f"has more than {SHAPES_MAX} shapes")
    state = _mapping(document.get("robot_state")) if isinstance(document, Mapping) else {}
    for each in _list(state.get("attached_collision_objects")):
        scene.left_out.append(f"{_mapping(_mapping(each).get('object')).get('id', 'object')} (in the gripper)")
    if isinstance(world, Mapping) and _list(_mapping(_mapping(world.get("octomap")).get("octomap")).get("data")):
        scene.left_out.append("the octomap")
    if others := sorted(set(frames) - {"world", "/world", ""}):
        scene.notes.append(f"places in {', '.join(others)} are taken as the cell's world: it has to be the same frame")
    return scene


def _shapes(each: Mapping[str, Any], name: str, X: Array, folder: Path) -> Iterator[ForeignShape | str]:
    for kind in ("primitive", "mesh", "plane"):
        shapes = _list(each.get("planes" if kind == "plane" else f"{kind}es" if kind == "mesh" else "primitives"))
        poses = _list(each.get(f"{kind}_poses"))
        if len(shapes) > len(poses):
            raise SceneRefused(f"{name}: has {len(shapes)} of {kind} and {len(poses)} poses of them")
        for shape, placed in zip(shapes, poses, strict=False):
            if kind == "plane":
                yield "a plane"
            elif kind == "mesh":
                yield _mesh(_mapping(shape), name, X @ _message_pose(placed, name), folder)
            else:
                yield _primitive(_mapping(shape), name, X @ _message_pose(placed, name))


def _primitive(shape: Mapping[str, Any], name: str, X: Array) -> ForeignShape | str:
    said = str(shape.get("type", "")).lower()
    kind = TYPES.get(int(said), said) if said.isdecimal() else said
    numbers = [str(x) for x in _list(shape.get("dimensions"))]
    sizes = numbers_of(numbers, {"box": 3, "sphere": 1}.get(kind, 2), f"{name}: {kind}")
    return shape_or_reason(name, kind, X, sizes[::-1] if kind in ("cylinder", "cone") else sizes)


def _mesh(given: Mapping[str, Any], name: str, X: Array, folder: Path) -> ForeignShape | str:
    if "resource" in given:  # source: robowflex_library, yaml.cpp: a mesh as MotionBenchMaker names it, by its file
        scale = _coordinates(given.get("dimensions", ["1"] * 3), "xyz", name)
        return mesh_at(name, X, folder, str(given["resource"]), scale)
    vertices = [_coordinates(vertex, "xyz", name) for vertex in _list(given.get("vertices"))]
    triangles = _list(given.get("triangles"))
    corners = [each if isinstance(each, list) else _list(_mapping(each).get("vertex_indices")) for each in triangles]
    faces = [[int(i) for i in numbers_of([str(i) for i in face], 3, f"{name}: triangle")] for face in corners]
    return ForeignShape(name, "mesh", X, {"scale": 1.0}, mesh_text(np.array(vertices), faces))


def _message_pose(given: Any, name: str) -> Array:
    table = _mapping(given)
    position = _coordinates(table.get("position"), "xyz", name)
    return _pose(position, _coordinates(table.get("orientation"), "xyzw", name), name)


def _coordinates(given: Any, keys: str, name: str) -> list[float]:
    values = [given.get(key) for key in keys] if isinstance(given, Mapping) else _list(given)
    return numbers_of([str(value) for value in values], len(keys), name)


def _mapping(given: Any) -> Mapping[str, Any]:
    return given if isinstance(given, Mapping) else {}


def _list(given: Any) -> list[Any]:
    return given if isinstance(given, list) else []
