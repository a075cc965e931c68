"""Reading shapes, of the surroundings and of the tool, and which of them may touch.

Boxes are read by their corners, others by pose and size, meshes and points by the boxes that cover them, and a mesh
that is a room by the boxes whose common part it is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, read_only
from planner.cell.capsule_cover import boxes_cover, cylinder_cover, round_cover
from planner.cell.fields import UNKNOWN_KEY, choice, exactly, merge_defaults, number, placement, tables, vector
from planner.cell.meshes import CELL_M, WALLED, MeshCover, cover_in, cover_key, walls_in
from planner.cell.model import FARTHEST_M, AllowedContact, ToolCapsule
from planner.cell.shapes import SIZE_MIN_M, SIZES, Box, Solid, shape_of
from planner.errors import CellError
from planner.fields import did_you_mean
from planner.robots import Robot, capsule_rows
from planner.rotations import pose

KEEP_IN = (*SIZES, "mesh")
COVERED = {"mesh": ".stl, .obj or .ply", "points": ".ply"}  # shapes of files, and the kinds of these
CELL_MIN_M = 1e-3  # [m] of a grid about points
POSE = {"position_m": None, "rotation_vector_rad": [0.0, 0.0, 0.0]}
IN_THE_WORLD = {"position_m": [0.0, 0.0, 0.0]}  # pose of points without one
NAME_PATTERN = re.compile(r"[^\s,:;]([^,:;]{0,62}[^\s,:;])?")  # of what can be printed; in a plan , : ; end a name
OTHERS = ("object", "floor", "bin", "rim")  # what else a flight or a posture comes close to
TOOL = "tool_"  # with a number: a capsule of the tool
SIZE_MAX_M = 1e3  # [m] so is a larger one: mostly it is in millimetres
CLEARANCE_MAX_M = 1.0  # [m]
SCALE_MIN = 1e-6  # [-] of a mesh


def corners(entry: Mapping[str, Any], where: str) -> Box:
    """Returns the box of a table with its corners alone.

    Raises:
        CellError: a key is unknown or missing, or a corner is refused.
    """
    exactly(entry, ("lower_m", "upper_m"), where)
    box = Box(vector(entry, "lower_m", where, 3), vector(entry, "upper_m", where, 3))
    if not np.all(box.lower < box.upper):
        raise CellError(f"{where}lower_m", box.lower.tolist(), "must be below upper_m in every axis")
    return box


def keep_out_shapes(
    table: Mapping[str, Any], meshes: bytes | None = None
) -> tuple[tuple[Solid, ...], dict[str, tuple[str, ...]]]:
    """Returns the keep-out shapes of the table `[surroundings]`; a mesh, or points, are the boxes that cover them.

    And, by the name of each entry, the names of the shapes that stand for it.

    Args:
        table: the table.
        meshes: what became of the mesh files, see `covers_of`.

    Raises:
        CellError: a field of one is refused, or two have the same name.
    """
    where = "surroundings.keep_out"
    found: dict[str, Solid] = {}
    bodies: dict[str, tuple[str, ...]] = {}
    for i, entry in enumerate(tables(table["keep_out"], where)):
        is_covered = str(entry.get("shape")) in COVERED
        shapes = _covered(entry, f"{where}[{i}].", i, meshes) if is_covered else [_shape(entry, f"{where}[{i}].")]
        names = tuple(shape.called(i) for shape in shapes)
        body = _body_name(entry, names, i)
        if body in bodies or body in found:
            raise CellError(f"{where}[{i}].name", body, "is what another one is called")
        bodies[body] = names
        for shape, name in zip(shapes, names, strict=True):
            if name in found:
                raise CellError(f"{where}[{i}].name", name, "is what another one is called")
            found[name] = _numbered(shape, name, len(found))
    return tuple(found.values()), bodies


def _numbered(shape: Solid, name: str, number_: int) -> Solid:
    """Returns a shape that is called `name` as the one of a number: behind a mesh it is not that of its table."""
    return shape if shape.called(number_) == name else replace(shape, name=name)


def _body_name(entry: Mapping[str, Any], names: tuple[str, ...], number_: int) -> str:
    """Returns the name of an entry: that of its only shape, or of the mesh that several boxes cover."""
    return names[0] if len(names) == 1 else str(entry.get("name") or f"{entry['shape']} {number_}")


def keep_in_shapes(table: Mapping[str, Any], base: Array, meshes: bytes | None = None) -> tuple[Solid, ...]:
    """Returns the keep-in shapes of the table `[surroundings]`; a convex mesh is the common part of several boxes.

    Args:
        table: the table.
        base: where the arm stands in the world (3,) [m].
        meshes: what became of the mesh files, see `covers_of`.

    Raises:
        CellError: a field of one is refused, two have the same name, or one reaches far from the arm.
    """
    found: dict[str, Solid] = {}
    for i, entry in enumerate(tables(table["keep_in"], "surroundings.keep_in")):
        where = f"surroundings.keep_in[{i}]."
        is_mesh = entry.get("shape") == "mesh"
        shapes = _covered(entry, where, i, meshes, WALLED) if is_mesh else [_shape(entry, where, KEEP_IN)]
        for shape in shapes:
            name = shape.called(i)
            if name in found:
                raise CellError(f"{where}name", name, "is what another one is called")
            _check_near(entry, where, shape, base)
            found[name] = _numbered(shape, name, len(found))
    return tuple(found.values())


def _check_near(entry: Mapping[str, Any], where: str, shape: Solid, base: Array) -> None:
    """Refuses a shape that reaches far from the arm.

    Raises:
        CellError: it does; by the first corner that is far away, or by its pose.
    """
    for side in ("lower", "upper"):
        corner = getattr(shape, side)
        away_m = np.abs(corner - base)
        axis = int(away_m.argmax())
        if away_m[axis] <= FARTHEST_M:
            continue
        reason = f"is {away_m[axis]:.6g} m from the arm, more than {FARTHEST_M:g} m"
        if "lower_m" in entry:
            raise CellError(f"{where}{side}_m[{axis}]", float(corner[axis]), reason)
        raise CellError(f"{where}pose", entry["pose"], f"one end of the {shape.kind} {reason}")


class ToolShape(NamedTuple):
    """A shape of the tool.

    Attributes:
        kind: box, cylinder, sphere, capsule or mesh.
        capsules: that contain it.
        beyond_m: how far they reach beyond it [m]; 0 where they are the shape itself.
    """

    kind: str
    capsules: tuple[ToolCapsule, ...]
    beyond_m: float


def tool_shapes(table: Mapping[str, Any], meshes: bytes | None = None) -> list[ToolShape]:
    """Returns the shapes of the table `[tool]`, which have the form of keep-out shapes, in the flange frame.

    Args:
        table: the table.
        meshes: what became of the mesh files, see `covers_of`.

    Raises:
        CellError: a field of one is refused.
    """
    found = []
    for i, entry in enumerate(tables(table["shapes"], "tool.shapes")):
        where = f"tool.shapes[{i}]."
        for key in ("name", "clearance_m"):
            if key in entry:
                raise CellError(f"{where}{key}", None, f"{UNKNOWN_KEY}: what stands for it is called tool_0, tool_1 …")
        if entry.get("shape") == "mesh":
            boxes = _covered(entry, where, i, meshes)
            beyond_m = entry.get("scale", 1.0) * _mesh_beyond(entry, meshes)
            found.append(_as_capsules("mesh", boxes, beyond_m))
        else:
            shape = _shape(entry, where, (*SIZES, "mesh"))
            found.append(_as_capsules(shape.kind, [shape], 0.0))
    return found


def _mesh_beyond(entry: Mapping[str, Any], meshes: bytes | None) -> float:
    """Returns how far the boxes of a mesh that was read reach beyond it, in the unit of its file."""
    known = cover_in(meshes, cover_key(entry) or "")
    return 0.0 if isinstance(known, str) else known[0].beyond


def _as_capsules(kind: str, shapes: Sequence[Solid], beyond_m: float) -> ToolShape:
    """Returns the capsules that contain a shape, or boxes along the same axes, which reach `beyond_m` beyond a mesh."""
    X = shapes[0].X_WC
    x, _, z = shapes[0].extent.tolist()
    if kind == "cylinder":
        cover = cylinder_cover(0.5 * x, z)
    elif kind in ("sphere", "capsule"):
        cover = round_cover(0.5 * x, z - x)
    else:
        middles = np.array([(shape.X_WC[:3, 3] - X[:3, 3]) @ X[:3, :3] for shape in shapes])
        halves = 0.5 * np.array([shape.extent for shape in shapes])
        cover = boxes_cover(middles - halves, middles + halves)
    capsules = tuple(ToolCapsule(_moved(X, c.start), _moved(X, c.end), c.radius_m) for c in cover.capsules)
    return ToolShape(kind, capsules, cover.beyond_m + beyond_m)


def _moved(X: Array, p: Array) -> Array:
    """Returns a point (3,) of a frame that has the pose `X` (4, 4)."""
    return read_only(X[:3, :3] @ p + X[:3, 3])


def _covered(entry: Mapping[str, Any], where: str, number_: int, meshes: bytes | None, use: str = "") -> list[Solid]:
    """Returns the boxes that stand for a mesh or points, called like it, with numbers where there are several."""
    kind = entry["shape"]
    name, clearance_m, rest = _named(entry, where)
    defaults = {"scale": 1.0} if kind == "mesh" else {"scale": 1.0, "cell_m": CELL_M, "pose": IN_THE_WORLD}
    rest = exactly({**defaults, **rest}, ("shape", "pose", "file", *(key for key in defaults if key != "pose")), where)
    X_WM = _pose(rest, where)
    scale = number(rest, "scale", where, SCALE_MIN, 1.0 / SCALE_MIN)
    if kind == "points":
        number(rest, "cell_m", where, CELL_MIN_M, SIZE_MAX_M)
    covers = _covers(rest, where, meshes, use)
    extents = [np.ptp([made.lower.min(axis=0), made.upper.max(axis=0)], axis=0) for made in covers]
    largest_m = float(np.max(extents)) * scale
    if not SIZE_MIN_M <= largest_m <= SIZE_MAX_M:
        reason = f"makes the {kind} {largest_m:.6g} m large: a file in millimetres has 0.001"
        raise CellError(f"{where}scale", scale, reason)
    places = []
    sizes_m = []
    for made in covers:
        middles = 0.5 * scale * (made.upper + made.lower) @ made.axes.T
        places += [X_WM @ pose(middle, made.axes) for middle in middles]
        sizes_m += list(scale * (made.upper - made.lower))
    called = name or f"{kind} {number_}"
    names = [called] if len(places) == 1 else [f"{called} {k}" for k in range(len(places))]
    return [shape_of("box", *each, clearance_m) for each in zip(places, sizes_m, names, strict=True)]


def _covers(entry: Mapping[str, Any], where: str, meshes: bytes | None, use: str) -> list[MeshCover]:
    """Returns what was made of the file of a mesh or of points.

    Raises:
        CellError: it names no file, or one that is refused.
    """
    key = cover_key(entry, use)
    if key is None:
        raise CellError(
            f"{where}file", entry["file"], f"must name a file beside the cell file: {COVERED[entry['shape']]}"
        )
    known = walls_in(meshes, key) if use == WALLED else cover_in(meshes, key)
    if isinstance(known, str):
        raise CellError(f"{where}file", entry["file"], known)
    return known if isinstance(known, list) else [known[0]]


def _named(entry: Mapping[str, Any], where: str) -> tuple[str, float | None, dict[str, Any]]:
    """Returns the name of a shape, its own clearance [m], and its other keys."""
    clearance_m = number(entry, "clearance_m", where, 0.0, CLEARANCE_MAX_M) if "clearance_m" in entry else None
    rest = {key: value for key, value in entry.items() if key not in ("name", "clearance_m")}
    return _name(entry, where), clearance_m, rest


def _pose(rest: Mapping[str, Any], where: str) -> Array:
    """Returns the pose of a shape in the world (4, 4)."""
    given = exactly(merge_defaults({"pose": rest["pose"]}, {"pose": POSE}, where)["pose"], tuple(POSE), f"{where}pose.")
    return placement(given, "position_m", "rotation_vector_rad", f"{where}pose.", SIZE_MAX_M)


def _shape(entry: Mapping[str, Any], where: str, kinds: tuple[str, ...] = (*SIZES, *COVERED)) -> Solid:
    """Returns the shape of a table that is no file's; `kinds` are what may stand there."""
    name, clearance_m, rest = _named(entry, where)
    if "shape" not in rest and "pose" not in rest:
        box = corners(rest, where)
        return Box(box.lower, box.upper, name, clearance_m)
    kind = choice({"shape": "box", **rest}, "shape", where, kinds)
    rest = exactly({"shape": kind, **rest}, ("shape", "pose", *SIZES[kind]), where)
    X = _pose(rest, where)
    if kind == "box":
        return shape_of(kind, X, vector(rest, "size_m", where, 3, SIZE_MIN_M, SIZE_MAX_M), name, clearance_m)
    sizes = [number(rest, key, where, SIZE_MIN_M, SIZE_MAX_M) for key in SIZES[kind]]
    return shape_of(kind, X, np.array([*sizes, 0.0][:2]), name, clearance_m)


def is_reserved(name: str) -> bool:
    """Returns whether something that is no shape is called so in plans."""
    return name in (*OTHERS, AllowedContact.TOOL) or name.startswith(TOOL) or name in capsule_rows("ur5e")


def _name(entry: Mapping[str, Any], where: str) -> str:
    name = entry.get("name", "")
    if "name" in entry and not (isinstance(name, str) and name.isprintable() and NAME_PATTERN.fullmatch(name)):
        raise CellError(f"{where}name", name, "must be 1 to 64 printable characters without , : ;")
    if name and is_reserved(name):
        raise CellError(f"{where}name", name, "is what something else is called in a plan")
    return name


def contacts(
    table: Mapping[str, Any], robot: Robot, tool_capsules: int, bodies: Mapping[str, tuple[str, ...]]
) -> tuple[AllowedContact, ...]:
    """Returns the pairs of the list `may_touch` of the table `[surroundings]`.

    Args:
        table: the table.
        robot: the arm.
        tool_capsules: number of the tool's capsules.
        bodies: what is kept out, by name, each with the names of the shapes that stand for it.

    Raises:
        CellError: a name is unknown, or nothing moves one against the other.
    """
    rows = capsule_rows(robot.shape.of)
    standing = {name for name, row in rows.items() if row["frame"] == 0}
    parts = [*rows, AllowedContact.TOOL, *(f"{TOOL}{i}" for i in range(tool_capsules)), AllowedContact.OBJECT]
    found = []
    for i, entry in enumerate(tables(table["may_touch"], "surroundings.may_touch")):
        where = f"surroundings.may_touch[{i}]."
        exactly(entry, ("a", "b"), where)
        for key in ("a", "b"):
            _check_known(entry[key], f"{where}{key}", [*parts, *bodies])
        a, b = sorted((entry["a"], entry["b"]), key=lambda name: name in bodies)
        fixed = standing | set(bodies)
        if a == b or {a, b} <= fixed:
            raise CellError(
                f"{where}b", entry["b"], f"does not move against {entry['a']!r}: one of both must be a part"
            )
        found.append(AllowedContact(a, b, bodies.get(b, ())))
    return tuple(found)


def _check_known(name: Any, field: str, known: Sequence[str]) -> None:
    """Refuses a name that nothing has.

    Raises:
        CellError: it is such, or no name.
    """
    if not isinstance(name, str) or name not in known:
        raise CellError(field, name, f"must be one of {', '.join(known)}{did_you_mean(name, known)}")
