"""Worlds in MJCF, as MuJoCo reads them: the geoms of bodies that nothing moves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from planner.arrays import Array
from planner.documents import NotXml, parse_xml, read_file
from planner.errors import FileRefused
from planner.rotations import axes_along, pose, quaternion_to_matrix, rotation_vector_to_matrix
from planner.scenes.foreign import (
    TEXT_MAX,
    ForeignScene,
    ForeignShape,
    SceneRefused,
    mesh_at,
    numbers_of,
    shape_or_reason,
)

JOINTS = ("joint", "freejoint")
INCLUDED_BYTES = 20_000_000  # [byte] of an included file
LENGTHS = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}  # how many numbers of `size` each type takes


class MjcfReader:
    """What a file says for all of its bodies.

    Attributes:
        folder: in which its meshes are.
        turn: of an angle in the file [rad].
        order: of the axes that `euler` turns about, lower case about those that turn along.
        defaults: attributes of geoms and meshes by class; those of the outermost one under "".
        meshes: attributes of the meshes, by name.
        scene: what was read.
    """

    def __init__(self, root: Element, folder: Path) -> None:
        """Takes `<mujoco>`, and the folder of its file."""
        settings: dict[str, str] = {}
        for compiler in root.iterfind("compiler"):
            settings |= compiler.attrib
        self.folder = folder / settings.get("meshdir", settings.get("assetdir", ""))
        self.turn = 1.0 if settings.get("angle", "degree") == "radian" else np.pi / 180.0
        self.order = settings.get("eulerseq", "xyz")
        if len(self.order) != 3 or set(self.order.lower()) - set("xyz"):
            raise SceneRefused(f"turns about {self.order[:TEXT_MAX]!r} (eulerseq)")
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"": {"geom": {}, "mesh": {}}}
        for default in root.iterfind("default"):
            self._read_default(default, self.defaults[""], True)
        self.meshes = {_mesh_name(mesh): self._full(mesh, "") for mesh in root.iterfind("asset/mesh")}
        self.scene = ForeignScene()

    def _read_default(self, default: Element, above: Mapping[str, dict[str, str]], is_outermost: bool) -> None:
        own = {tag: dict(attributes) for tag, attributes in above.items()}
        for element in default:
            if element.tag in own:
                own[element.tag] |= element.attrib
        self.defaults[default.get("class", "")] = own
        if is_outermost:
            self.defaults[""] = own
        for inner in default.iterfind("default"):
            self._read_default(inner, own, False)

    def _full(self, element: Element, kind: str) -> dict[str, str]:
        """Returns the attributes of an element with those of its class, which is `kind` where it names none."""
        return {**self.defaults.get(element.get("class", kind), {}).get(element.tag, {}), **element.attrib}

    def read(self, body: Element, X_WB: Array, name: str, kind: str) -> None:
        """Reads the geoms of a body and of those within it.

        Args:
            body: `<worldbody>`, `<body>` or `<frame>`.
            X_WB: its pose in the world (4, 4).
            name: of the body, or of the one that it is in.
            kind: class of geoms that name none.
        """
        kind = body.get("childclass", kind)
        if any(body.find(tag) is not None for tag in JOINTS):
            self.scene.left_out.append(f"{name} (moved by a joint)")
            return
        for tag in ("include", "replicate", "attach", "composite", "flexcomp"):
            if body.find(tag) is not None:
                self.scene.left_out.append(f"what {name} has by <{tag}>")
        for geom in body.iterfind("geom"):
            given = self._full(geom, kind)
            called = given.get("name", name)
            self.scene.take(called, self._geom(given, X_WB, called))
        for inner in (*body.iterfind("body"), *body.iterfind("frame")):
            called = inner.get("name", name)
            self.read(inner, X_WB @ self._placed(inner.attrib, called), called, kind)

    def _geom(self, given: Mapping[str, str], X_WB: Array, name: str) -> ForeignShape | str:
        kind = given.get("type", "mesh" if "mesh" in given else "sphere")
        if given.get("contype") == "0" and given.get("conaffinity") == "0":
            return f"a {kind} that is only drawn"
        if kind == "plane":
            return "a plane: a floor is surroundings.floor_z_m"
        if kind == "mesh" or "mesh" in given:  # MuJoCo puts a shape of another kind about the mesh
            return self._mesh(given, X_WB, name)
        if kind not in LENGTHS:
            return shape_or_reason(name, kind, X_WB, ())
        words = given.get("size", "").split()
        if "fromto" not in given:
            size = numbers_of(words[: LENGTHS[kind]], LENGTHS[kind], f"{name}: size")
            X = X_WB @ self._placed(given, name)
        else:
            X, half = _between(numbers_of(given["fromto"].split(), 6, f"{name}: fromto"))
            X = X_WB @ X
            across = numbers_of(words[:1], 1, f"{name}: size")
            size = [*(across * (LENGTHS[kind] - 1)), half]
        numbers = [2.0 * x for x in size] if kind == "box" else [size[0], *(2.0 * x for x in size[1:])]
        return shape_or_reason(name, kind, X, numbers)

    def _mesh(self, given: Mapping[str, str], X_WB: Array, name: str) -> ForeignShape | str:
        mesh = self.meshes.get(given.get("mesh", ""), {})
        if any(key in mesh for key in ("refpos", "refquat", "vertex", "builtin")):
            return "a mesh that is not as its file"
        scale = numbers_of(mesh.get("scale", "1 1 1").split(), 3, f"{name}: scale")
        return mesh_at(name, X_WB @ self._placed(given, name), self.folder, mesh.get("file", ""), scale)

    def _placed(self, given: Mapping[str, str], name: str) -> Array:
        """Returns the pose of a body or geom in what it is in (4, 4)."""
        place = numbers_of(given["pos"].split(), 3, f"{name}: pos") if "pos" in given else np.zeros(3)
        turns = {
            "quat": (4, _of_quaternion),
            "axisangle": (4, lambda x: rotation_vector_to_matrix(_unit(x[:3]) * x[3] * self.turn)),
            "euler": (3, self._of_angles),
            "xyaxes": (6, _of_axes),
            "zaxis": (3, lambda x: axes_along(_unit(x))),
        }
        for key, (count, turned) in turns.items():
            if key in given:
                return pose(place, turned(np.array(numbers_of(given[key].split(), count, f"{name}: {key}"))))
        return pose(place, np.eye(3))

    def _of_angles(self, angles: Array) -> Array:
        R = np.eye(3)
        for axis, angle in zip(self.order, angles, strict=True):
            step = rotation_vector_to_matrix(angle * self.turn * np.eye(3)["xyz".index(axis.lower())])
            R = R @ step if axis.islower() else step @ R
        return R


def scene_of_mjcf(root: Element, folder: Path) -> ForeignScene:
    """Returns the shapes of an MJCF file. Source: https://mujoco.readthedocs.io/en/stable/XMLreference.html

    Args:
        root: `<mujoco>`.
        folder: of the file.

    Raises:
        SceneRefused: a number in it is none.
    """
    _include(root, folder, set())
    reader = MjcfReader(root, folder)
    if root.find("include") is not None:
        reader.scene.left_out.append("what it has by <include>")
    for world in root.iterfind("worldbody"):
        reader.read(world, np.eye(4), "world", "")
    return reader.scene


def _include(element: Element, folder: Path, known: set[Path]) -> None:
    """Puts the elements of included files in their place; MuJoCo, too, includes a file once."""
    for i, child in reversed(list(enumerate(element))):
        path = (folder / child.get("file", "")).resolve()
        if child.tag != "include":
            _include(child, folder, known)
        elif path not in known:
            known.add(path)
            try:
                included = parse_xml(read_file(path, INCLUDED_BYTES))
            except (FileRefused, NotXml):
                continue  # it stays, to be named
            _include(included, folder, known)
            element[i : i + 1] = list(included)


def _mesh_name(mesh: Element) -> str:
    return mesh.get("name") or Path(mesh.get("file", "")).stem


def _between(ends: list[float]) -> tuple[Array, float]:
    """Returns the pose (4, 4) of the middle between two points, z along the line, and half its length [m]."""
    start, end = np.array(ends[:3]), np.array(ends[3:])
    length = float(np.linalg.norm(end - start))
    return pose(0.5 * (start + end), axes_along((end - start) / length) if length > 0.0 else np.eye(3)), 0.5 * length


def _of_quaternion(wxyz: Array) -> Array:
    return quaternion_to_matrix(np.roll(_unit(wxyz), -1))


def _of_axes(xy: Array) -> Array:
    x = _unit(xy[:3])
    y = _unit(xy[3:] - (x @ xy[3:]) * x)
    return np.column_stack([x, y, np.cross(x, y)])


def _unit(axis: Array) -> Array:
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise SceneRefused("has an axis, or a quaternion, that is zero")
    return axis / length
