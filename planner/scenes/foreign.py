"""What a scene of another program holds: shapes that a cell can keep out, and what it cannot, by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.cell import MESH_BYTES, MESH_KINDS
from planner.documents import read_file
from planner.errors import FileRefused
from planner.rotations import pose

SIZES = {  # keys of each shape, in the order of the numbers that `shape_or_reason` takes
    "box": ("size_m",),
    "sphere": ("radius_m",),
    "cylinder": ("radius_m", "length_m"),
    "capsule": ("radius_m", "length_m"),
}
SCHEMES = ("package://", "model://")  # before the name of a package, which is a folder somewhere above the file
TEXT_MAX = 60  # characters of what is quoted from a file
ALONG = 1e-6  # [-] sine of an angle by which a box along the axes may be turned: rounding of a file
DIGITS = 12  # decimals that a cell file is written with


class SceneRefused(ValueError):
    """A file is no scene of its kind; the message is the end of a sentence."""


@dataclass(frozen=True, eq=False)
class ForeignShape:
    """A shape of another program's scene.

    Attributes:
        name: of the object that it is of.
        kind: box, sphere, cylinder, capsule or mesh.
        X: its pose in the scene (4, 4).
        keys: its size, by the keys of `keep_out`.
        mesh: content and kind, such as "stl", of a mesh.
    """

    name: str
    kind: str
    X: Array
    keys: Mapping[str, Any]
    mesh: tuple[bytes, str] | None = None


@dataclass
class ForeignScene:
    """What a file holds.

    Attributes:
        shapes: that are taken over.
        left_out: names of the others, with the reasons.
        notes: what else a person should know, in sentences.
        X_WB: pose of the base of an arm in the file (4, 4); None without one.
    """

    shapes: list[ForeignShape] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    X_WB: Array | None = None

    def take(self, name: str, found: ForeignShape | str) -> None:
        """Takes a shape over, or notes why it is left out."""
        if isinstance(found, ForeignShape):
            self.shapes.append(found)
        else:
            self.left_out.append(f"{name} ({found})")


def shape_or_reason(name: str, kind: str, X: Array, numbers: Sequence[float]) -> ForeignShape | str:
    """Returns a shape of a kind, or why it is left out, in words.

    Args:
        name: of its object.
        kind: as the file calls it; a cone becomes the cylinder about it.
        X: its pose in the scene (4, 4).
        numbers: of a box its edges, of a sphere its radius, of the others radius and length [m].
    """
    called = f"{'an' if kind[:1] in 'aeiou' else 'a'} {kind[:TEXT_MAX]}"
    kind = "cylinder" if kind == "cone" else kind
    if kind not in SIZES or len(numbers) != (3 if kind == "box" else len(SIZES[kind])):
        return called
    if kind == "box":
        X, edges = _straight(X, np.asarray(numbers))
        numbers = edges.tolist()
    rounded = [round(float(x), DIGITS) for x in numbers]
    if not all(math.isfinite(x) and x > 0.0 for x in rounded):
        return f"{called} without thickness"
    sizes = [rounded] if kind == "box" else rounded
    return ForeignShape(name, kind, X, dict(zip(SIZES[kind], sizes, strict=True)))


def _straight(X: Array, size: Array) -> tuple[Array, Array]:
    """Returns pose and size of a box, not turned where it is so by quarter turns, but for the rounding of a file."""
    R = X[:3, :3]
    if (np.sort(np.abs(R))[:, :2] > ALONG).any():
        return X, size
    return pose(X[:3, 3], np.eye(3)), np.abs(R).round() @ size


def mesh_at(name: str, X: Array, folder: Path, place: str, scale: Sequence[float]) -> ForeignShape | str:
    """Returns the mesh that a scene names, or why it is left out, in words.

    Args:
        name: of its object.
        X: its pose in the scene (4, 4).
        folder: of the scene's file.
        place: of the mesh, as the file writes it; that of a package is looked for in the folders above the file.
        scale: along its three axes.
    """
    if len(set(scale)) != 1 or not scale[0] > 0.0:
        return "a mesh of another scale in each direction"
    for scheme in SCHEMES:
        place = place.removeprefix(scheme).split("/", 1)[-1] if place.startswith(scheme) else place
    path = Path(place.removeprefix("file://"))
    kind = path.suffix[1:].lower()
    if kind not in MESH_KINDS:
        return f"a mesh in {kind.upper()[:TEXT_MAX] or 'no'} format"
    for here in (folder, *folder.resolve().parents):
        if (here / path).is_file():
            try:
                return ForeignShape(name, "mesh", X, {"scale": scale[0]}, (read_file(here / path, MESH_BYTES), kind))
            except FileRefused as error:
                return f"a mesh, and {path.name} {error.reason}"
    return f"a mesh, and {place[:TEXT_MAX]} is not there"


def mesh_text(vertices: Array, faces: Sequence[Sequence[int]]) -> tuple[bytes, str]:
    """Returns a mesh that a scene holds itself, as an OBJ file, and that kind.

    Raises:
        SceneRefused: a face has another corner than one of the vertices, or a coordinate is no number.
    """
    if not faces or not np.isfinite(vertices).all():
        raise SceneRefused("has a mesh without faces, or with corners that are no numbers")
    if min(map(min, faces)) < 0 or max(map(max, faces)) >= len(vertices):
        raise SceneRefused("has a mesh with a corner that is not there")
    lines = [f"v {' '.join(map(repr, vertex))}" for vertex in vertices.tolist()]
    lines += [f"f {' '.join(str(i + 1) for i in face)}" for face in faces]
    return "\n".join([*lines, ""]).encode(), "obj"


def numbers_of(words: Sequence[str], count: int, where: str) -> list[float]:
    """Returns finite numbers.

    Raises:
        SceneRefused: there are not `count` of them, or one is none.
    """
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        found = " ".join(words)[:TEXT_MAX]
        raise SceneRefused(
            f"{where}: {found!r} must be {count} numbers" if count > 1 else f"{where}: {found!r}: a number"
        )
    return numbers
