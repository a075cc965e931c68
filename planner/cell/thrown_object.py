"""The thrown object: a ball, or a body with a shape, its inertia and how it lies in the gripper.

Every clearance of a body is that of its hull, the capsule about its longest axis: while it is held, of the capsule;
in flight, of balls along its axis, which move with it. A body that is not longer than thick has a single ball about all
of it. Where a body comes down is told by its own shape (`ThrownBody.below`). A mesh is the simple shape that encloses
it: of the file only that is known to what follows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, read_only
from planner.cell.fields import choice, number, placement, vector
from planner.cell.meshes import ENCLOSED, EnclosedMesh, cover_key, shape_in
from planner.cell.shapes import SIZE_MIN_M, SIZES
from planner.errors import CellError
from planner.rotations import pose

OUT_M = 0.01  # [m] least displacement at which an object is out of the grip
RADIUS_M = 0.02  # [m] of a ball whose radius is not given
SIZE_MAX_M = 1.0  # [m] no gripper throws more; most that is larger is in millimetres
MASS_MIN_KG = 1e-6
MASS_MAX_KG = 100.0
DRAG_MAX = 10.0  # [-]
INERTIA_MIN_KG_M2 = 1e-12  # of a milligram a millimetre across; 0 is no body's
INERTIA_MAX_KG_M2 = 100.0
ROUNDING = 1e-6  # [-] of moments of inertia, as written, that add up to the third: those of a thin plate
APART = 1.5  # [-] distance of a hull's balls over the radius of the body: they are a quarter thicker than it
BALLS_MAX = 9  # [-] along one body; a thinner one has balls farther apart, and thicker
SCALE_MIN = 1e-6  # [-] of a mesh
KEYS = {**SIZES, "mesh": ("file", "scale")}  # of each shape
WHICH = {"mesh": ", which encloses the mesh best"}
PRESET = {("sphere", "radius_m"): RADIUS_M, ("mesh", "scale"): 1.0}  # where they are not given
OBJECT = {
    "shape": "sphere",
    "mass_kg": 0.05,
    "radius_m": None,
    "length_m": None,
    "size_m": None,
    "file": None,
    "scale": None,
    "inertia_kg_m2": None,
    "drag_coefficient": 0.0,
    "in_tool": {"position_m": [0.0, 0.0, 0.0], "rotation_vector_rad": [0.0, 0.0, 0.0]},
}


@dataclass(frozen=True)
class ThrownObject:
    """A ball: mass [kg], radius [m], drag coefficient [-] (0: no drag)."""

    mass_kg: float
    radius_m: float
    drag_coefficient: float

    @property
    def way_out_m(self) -> float:
        """The displacement in the gripper by which it is out of the grip [m]: its radius, but no less than `OUT_M`."""
        return max(self.radius_m, OUT_M)

    @property
    def drag_radius_m(self) -> float:
        """Radius of the disc that air resists as it does the object [m]."""
        return self.radius_m

    @property
    def inner_radius_m(self) -> float:
        """Radius of the largest ball about its centre within it [m]."""
        return self.radius_m

    @property
    def outer_radius_m(self) -> float:
        """Distance of its farthest point from its centre [m]."""
        return self.radius_m

    @property
    def balls_m(self) -> tuple[float, ...]:
        """Places of the hull's balls along its axis, from its centre [m]; a ball is one."""
        return (0.0,)

    @property
    def reach_m(self) -> float:
        """Distance of the outermost of them from the centre [m]."""
        return self.balls_m[-1]

    @property
    def hull_axis(self) -> Array:
        """Unit vector (3,) along the hull, in the axes of the tool; of a ball any."""
        return np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class ThrownBody(ThrownObject):
    """An object with a shape; its radius is that of its hull.

    Attributes:
        kind: box, cylinder or capsule.
        size_m: its extent along its own axes (3,) [m]; that of a cylinder or a capsule is longest along z, or round.
        inertia_kg_m2: about its own axes through its centre (3,) [kg m^2].
        R_TO: its axes in the tool (3, 3).
    """

    kind: str
    size_m: Array
    inertia_kg_m2: Array
    R_TO: Array

    @property
    def drag_radius_m(self) -> float:
        """Radius of the disc as large as its shadow is in the mean [m]: a quarter of a convex body's surface.

        Source: Cauchy's theorem on the mean projection of convex bodies.
        """
        return math.sqrt(_surface(self.kind, self.size_m) / (4.0 * math.pi))

    @property
    def inner_radius_m(self) -> float:
        """Radius of the largest ball about its centre within it [m]."""
        return 0.5 * float(self.size_m.min())

    @property
    def outer_radius_m(self) -> float:
        """Distance of its farthest point from its centre [m]."""
        return _outer_radius(self.kind, self.size_m)

    def below(self, R_WO: Array) -> Array:
        """Returns how far it reaches below its centre (...) [m] with its axes in the world (..., 3, 3).

        Source: support functions of box, cylinder and capsule.
        """
        half = 0.5 * self.size_m
        down = np.abs(R_WO[..., 2, :])
        if self.kind == "box":
            return np.asarray(down @ half)
        if self.kind == "capsule":
            return np.asarray((half[2] - half[0]) * down[..., 2] + half[0])
        return half[2] * down[..., 2] + half[0] * np.hypot(R_WO[..., 2, 0], R_WO[..., 2, 1])

    @cached_property
    def _hull(self) -> Hull:
        return _hull_of(self.kind, self.size_m)

    @property
    def hull_axis_O(self) -> Array:
        """Unit vector (3,) along the hull, in the body's own axes."""
        return np.eye(3)[self._hull.axis]

    @property
    def balls_m(self) -> tuple[float, ...]:
        """Places of the hull's balls along its axis, from its centre [m]."""
        return self._hull.balls_m

    @property
    def hull_axis(self) -> Array:
        """Unit vector (3,) along the hull, in the axes of the tool."""
        return self.R_TO[:, self._hull.axis]


class Hull(NamedTuple):
    """Balls of one radius along an axis that contain a body.

    Attributes:
        axis: of the body's own.
        radius_m: of each [m].
        balls_m: their places, from the centre [m].
    """

    axis: int
    radius_m: float
    balls_m: tuple[float, ...]


def _hull_of(kind: str, size: Array) -> Hull:
    """Returns the hull of a body: several balls where it is long, which contain it between them."""
    half = 0.5 * size
    axis = int(half.argmax())
    across = np.delete(half, axis)
    is_flat = kind == "box"
    thick = float(np.linalg.norm(across)) if is_flat else float(across[0])
    single = Hull(axis, _outer_radius(kind, size), (0.0,))
    if axis != 2 and not is_flat:  # of a disc
        return single
    core = 2.0 * (float(half[axis]) - (thick if kind == "capsule" else 0.0))  # that balls of the body's radius sweep
    pieces = min(math.ceil(core / (APART * thick)), BALLS_MAX - 1)
    count = 2 * (pieces // 2) + 1  # one is in the middle
    if count == 1:
        return single
    apart = core / (count - 1 if kind == "capsule" else count)
    places = apart * np.arange(-(count // 2), count // 2 + 1)
    return Hull(axis, math.hypot(thick, 0.5 * apart), tuple(places.tolist()))


def _outer_radius(kind: str, size: Array) -> float:
    """Returns the distance of a body's farthest point from its centre [m]."""
    half = 0.5 * size
    if kind == "capsule":
        return float(half[2])
    return float(np.linalg.norm(half if kind == "box" else half[[0, 2]]))


def _surface(kind: str, size: Array) -> float:
    """Returns the surface [m^2] of a body."""
    (x, y, z) = size.tolist()
    if kind == "box":
        return 2.0 * (x * y + y * z + z * x)
    return math.pi * x * (z if kind == "capsule" else z + 0.5 * x)


def _uniform_inertia(kind: str, mass: float, size: Array) -> Array:
    """Returns the moments of inertia (3,) [kg m^2] of a body of one density.

    Source: solids of uniform density; a capsule is a cylinder and two half balls, each about its own centre.
    """
    squares = size * size
    if kind == "box":
        return mass / 12.0 * (squares.sum() - squares)
    r = 0.5 * float(size[0])
    length = float(size[2]) - (2.0 * r if kind == "capsule" else 0.0)
    ends = mass * (4.0 * r / (4.0 * r + 3.0 * length) if kind == "capsule" else 0.0)
    middle = mass - ends
    across = middle * (3.0 * r * r + length**2) / 12.0 + ends * (0.4 * r * r + 0.25 * length**2 + 0.375 * length * r)
    return np.array([across, across, 0.5 * middle * r * r + 0.4 * ends * r * r])


class EnclosedObject(NamedTuple):
    """The shape about the mesh of an object.

    Attributes:
        kind: sphere, capsule, cylinder or box.
        X_MO: its pose in the frame of the file, of which a unit is 1 m times the scale (4, 4).
        size_m: its extent along its own axes (3,) [m].
        beyond_m: distance from the mesh that no point of its surface exceeds [m].
        volume_ratio: its volume over that of the mesh [-]; None of an open mesh.
    """

    kind: str
    X_MO: Array
    size_m: Array
    beyond_m: float
    volume_ratio: float | None


def enclosed_object(table: Mapping[str, Any], meshes: bytes | None) -> EnclosedObject | None:
    """Returns what stands for the mesh of a table `[object]` as read; None where it has none.

    Args:
        table: the table.
        meshes: what became of the mesh files, see `covers_of`.

    Raises:
        CellError: file or scale are refused.
    """
    return _enclosed(table, meshes) if table["shape"] == "mesh" else None


def _enclosed(table: Mapping[str, Any], meshes: bytes | None) -> EnclosedObject:
    where = "object."
    key = cover_key(table, ENCLOSED)
    if key is None:
        raise CellError(f"{where}file", table["file"], "must name a file beside the cell file: .stl, .obj or .ply")
    known = shape_in(meshes, key)
    if not isinstance(known, EnclosedMesh):
        raise CellError(f"{where}file", table["file"], known)
    scale = number(table, "scale", where, SCALE_MIN, 1.0 / SCALE_MIN)
    shape, volume = known
    size = scale * shape.size
    if not SIZE_MIN_M <= size.min() <= size.max() <= SIZE_MAX_M:
        measured = " x ".join(f"{each:.3g}" for each in size)
        reason = f"makes the {shape.kind} about the mesh {measured} m large, and each must lie in"
        millimetres = "a file in millimetres has 0.001"
        raise CellError(f"{where}scale", scale, f"{reason} [{SIZE_MIN_M:g}, {SIZE_MAX_M:g}] m; {millimetres}")
    X_MO = pose(scale * shape.centre, shape.axes)
    if not np.abs(X_MO[:3, 3]).max() <= SIZE_MAX_M:
        away = ", ".join(f"{x:.3g}" for x in X_MO[:3, 3])
        reason = (
            f"lies about ({away}) m of its own origin, which may be {SIZE_MAX_M:g} m away: move it there, or scale it"
        )
        raise CellError(f"{where}file", table["file"], reason)
    ratio = shape.volume / volume if volume else None
    return EnclosedObject(shape.kind, X_MO, size, scale * shape.beyond, ratio)


def object_of(table: dict[str, Any], meshes: bytes | None = None) -> tuple[ThrownObject, Array]:
    """Returns the object of the table `[object]`, and where its centre lies in the tool (3,) [m].

    Args:
        table: the table.
        meshes: what became of the mesh files, see `covers_of`.

    Raises:
        CellError: a field of it is refused, is missing for its shape, or is of another one.
    """
    where = "object."
    kind = choice(table, "shape", where, KEYS)
    for key in ("size_m", "radius_m", "length_m", "file", "scale"):
        if table[key] is None:
            table[key] = PRESET.get((kind, key))
        if (table[key] is None) == (key in KEYS[kind]):
            reason = "is missing" if table[key] is None else f"does not belong to a {kind}"
            raise CellError(where + key, table[key], reason)
    X_TO = placement(table["in_tool"], "position_m", "rotation_vector_rad", f"{where}in_tool.", SIZE_MAX_M)
    mass = number(table, "mass_kg", where, MASS_MIN_KG, MASS_MAX_KG)
    drag = number(table, "drag_coefficient", where, 0.0, DRAG_MAX)
    kind, size, X_MO = _shaped(kind, table, meshes)
    X_TO = X_TO if X_MO is None else read_only(X_TO @ X_MO)
    if kind == "sphere":
        if table["inertia_kg_m2"] is not None:
            of = f"{where}inertia_kg_m2"
            raise CellError(of, table["inertia_kg_m2"], f"does not belong to a sphere{WHICH.get(table['shape'], '')}")
        return ThrownObject(mass, 0.5 * float(size[0]), drag), X_TO[:3, 3]
    inertia = _inertia(kind, mass, size, table)
    radius = _hull_of(kind, size).radius_m
    return ThrownBody(mass, radius, drag, kind, read_only(size), read_only(inertia), X_TO[:3, :3]), X_TO[:3, 3]


def _shaped(kind: str, table: Mapping[str, Any], meshes: bytes | None) -> tuple[str, Array, Array | None]:
    """Returns kind and extent (3,) [m] of an object, and its pose in a mesh's frame (4, 4); None without a mesh."""
    if kind == "mesh":
        made = _enclosed(table, meshes)
        return made.kind, made.size_m, made.X_MO
    if kind == "sphere":
        return kind, np.full(3, 2.0 * number(table, "radius_m", "object.", 0.0, SIZE_MAX_M)), None
    return kind, _size(kind, table, "object."), None


def _inertia(kind: str, mass: float, size: Array, table: Mapping[str, Any]) -> Array:
    """Returns the moments of inertia (3,) [kg m^2] of a body: those given, or those of one density."""
    where = "object."
    if table["inertia_kg_m2"] is None:
        return _uniform_inertia(kind, mass, size)
    inertia = vector(table, "inertia_kg_m2", where, 3, INERTIA_MIN_KG_M2, INERTIA_MAX_KG_M2)
    others = float(inertia.sum() - inertia.max())
    if inertia.max() > others * (1.0 + ROUNDING):
        worst = int(inertia.argmax())
        reason = f"is more than the other two moments together, {others:g} kg m^2: no body has such an inertia"
        raise CellError(f"{where}inertia_kg_m2[{worst}]", float(inertia[worst]), reason)
    return inertia


def _size(kind: str, table: Mapping[str, Any], where: str) -> Array:
    """Returns the extent (3,) [m] of a body along its own axes."""
    if kind == "box":
        return vector(table, "size_m", where, 3, SIZE_MIN_M, SIZE_MAX_M)
    wide = 2.0 * number(table, "radius_m", where, SIZE_MIN_M, SIZE_MAX_M)
    long = number(table, "length_m", where, SIZE_MIN_M, SIZE_MAX_M)
    return np.array([wide, wide, long + (wide if kind == "capsule" else 0.0)])
