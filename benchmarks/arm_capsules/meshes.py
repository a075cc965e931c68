"""Triangles of the links of an arm, in their DH frames, from a folder of ur_description: STL and COLLADA files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from planner.robots import Robot

Vector = NDArray[np.float64]

LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")  # in frames 0 to 6
# [m] The pictures of the UR10 have loose pieces up to 3 cm beside the arm, of which its collision meshes know nothing.
STRAY_M = 0.002
TURN = np.pi / 2
HULL_BATCH = 1000  # triangles compared with the faces of a hull at a time


def arm_surface(robot: Robot, folder: Path) -> dict[str, Vector]:
    """Returns the triangles (n, 3, 3) [m] of every link in its DH frame.

    They are those of the pictures (`visual`), which are finer than the collision meshes; the latter are partly convex
    hulls of whole links. Pieces outside of the hull of a link's collision mesh are left out.

    Raises:
        OSError: the folder lacks a file.
    """
    config = folder / "config" / robot.name
    files = yaml.safe_load((config / "visual_parameters.yaml").read_text())["mesh_files"]
    offsets = yaml.safe_load((config / "physical_parameters.yaml").read_text())["offsets"]
    surface = {}
    for frame, link in enumerate(LINKS):
        X = _mesh_in_dh_frame(robot, frame, offsets, files[link].get("visual_offset", 0.0))
        seen = _triangles(folder / files[link]["visual"]["mesh"]["path"])
        solid = _triangles(folder / files[link]["collision"]["mesh"]["path"])
        kept = seen[_outside(seen, solid) < STRAY_M]
        surface[link] = kept @ X[:3, :3].T + X[:3, 3]
    return surface


def _mesh_in_dh_frame(robot: Robot, frame: int, offsets: dict[str, float], along_z: float) -> Vector:
    """Returns the pose (4, 4) of a link's mesh in its DH frame.

    source: ur_description, urdf/ur_macro.xacro, the origins of the links' visuals; a link's frame there is the DH frame
    without its last steps, the translation along x and the twist.
    """
    places = {
        "base": _pose([0.0, 0.0, np.pi], 0.0),
        "shoulder": _pose([0.0, 0.0, np.pi], 0.0),
        "upper_arm": _pose([TURN, 0.0, -TURN], offsets["shoulder_offset"]),
        "forearm": _pose([TURN, 0.0, -TURN], offsets["elbow_offset"]),
        "wrist_1": _pose([TURN, 0.0, 0.0], along_z),
        "wrist_2": _pose([0.0, 0.0, 0.0], along_z),
        "wrist_3": _pose([TURN, 0.0, 0.0], along_z),
    }
    X = places[LINKS[frame]]
    if frame == 0:
        return X
    last = np.eye(4)
    last[:3, :3] = Rotation.from_euler("x", robot.alpha[frame - 1]).as_matrix()
    last[0, 3] = robot.a[frame - 1]
    return np.linalg.inv(last) @ X


def _pose(rpy: list[float], z: float) -> Vector:
    """Returns the pose (4, 4) of a URDF origin at height z."""
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    X[2, 3] = z
    return X


def _outside(triangles: Vector, solid: Vector) -> Vector:
    """Returns how far each triangle (n, 3, 3) is outside of the hull of others [m]; negative inside."""
    faces = ConvexHull(solid.reshape(-1, 3)).equations
    corners = triangles.reshape(-1, 3)
    beyond = [
        (part @ faces[:, :3].T + faces[:, 3]).max(axis=1)
        for part in np.array_split(corners, len(corners) // HULL_BATCH + 1)
    ]
    return np.concatenate(beyond).reshape(-1, 3).max(axis=1)


def _triangles(path: Path) -> Vector:
    """Returns the triangles (n, 3, 3) [m] of a file."""
    return _stl(path) if path.suffix == ".stl" else _collada(path)


def _stl(path: Path) -> Vector:
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    return np.frombuffer(data, facet, count, offset=84)["corners"].astype(float)


def _collada(path: Path) -> Vector:
    """Returns the triangles of a COLLADA file; of transforms it knows matrices, the only ones in ur_description."""
    root = ElementTree.parse(path).getroot()
    names = {"c": root.tag[1:].partition("}")[0]}
    unit = root.find(".//c:unit", names)
    scale = 1.0 if unit is None else float(unit.get("meter", "1"))
    geometries = {each.get("id"): each for each in root.iterfind(".//c:geometry", names)}
    found = []
    nodes = [(node, np.eye(4)) for node in root.iterfind(".//c:visual_scene/c:node", names)]
    while nodes:
        node, X = nodes.pop()
        for matrix in node.iterfind("c:matrix", names):
            X = X @ np.array((matrix.text or "").split(), float).reshape(4, 4)
        for instance in node.iterfind("c:instance_geometry", names):
            for triangles in _faces(geometries[instance.get("url", "")[1:]], names):
                found.append(triangles @ X[:3, :3].T + X[:3, 3])
        nodes += [(child, X) for child in node.iterfind("c:node", names)]
    return scale * np.concatenate(found)


def _faces(geometry: ElementTree.Element, names: dict[str, str]) -> Iterator[Vector]:
    """Yields the triangles (n, 3, 3) of a geometry; polygons are cut into fans."""
    sources = {}
    for source in geometry.iterfind("c:mesh/c:source", names):
        numbers = source.find("c:float_array", names)
        if numbers is not None and numbers.text:
            sources["#" + source.get("id", "")] = np.array(numbers.text.split(), float)
    for vertices in geometry.iterfind("c:mesh/c:vertices", names):
        place = vertices.find("c:input[@semantic='POSITION']", names)
        assert place is not None
        sources["#" + vertices.get("id", "")] = sources.get(place.get("source", ""), np.empty(0))
    for kind in ("triangles", "polylist"):
        for faces in geometry.iterfind(f"c:mesh/c:{kind}", names):
            inputs = faces.findall("c:input", names)
            vertex = next(each for each in inputs if each.get("semantic") == "VERTEX")
            width = 1 + max(int(each.get("offset", "0")) for each in inputs)
            indices = np.array((faces.findtext("c:p", "", names)).split(), int).reshape(-1, width)
            corners = indices[:, int(vertex.get("offset", "0"))]
            counts = np.array((faces.findtext("c:vcount", "", names)).split(), int)
            at = sources[vertex.get("source", "")].reshape(-1, 3)
            yield at[corners[_fans(counts) if kind == "polylist" else np.arange(len(corners)).reshape(-1, 3)]]


def _fans(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns indices (n, 3) of the triangles of polygons with so many corners each, one polygon after another."""
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    fans = [[start, start + j, start + j + 1] for start, n in zip(first, counts, strict=True) for j in range(1, n - 1)]
    return np.array(fans, dtype=np.int64).reshape(-1, 3)
