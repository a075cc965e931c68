"""Reading what nothing enters: boxes by their corners, and shapes by pose and size."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from planner.cell.fields import choice, exactly, merge_defaults, number, placement, tables, vector
from planner.cell.shapes import Box, Solid, shape_of
from planner.errors import CellError
from planner.robots import capsule_rows

SIZES = {  # keys of each shape beyond `shape`, `pose`, `name` and `clearance_m`
    "box": ("size_m",),
    "cylinder": ("radius_m", "length_m"),
    "sphere": ("radius_m",),
    "capsule": ("radius_m", "length_m"),
}
POSE = {"position_m": None, "rotation_vector_rad": [0.0, 0.0, 0.0]}
NAME_PATTERN = re.compile(r"[^\s,:;]([^,:;]{0,62}[^\s,:;])?")  # of what can be printed; in a plan , : ; end a name
OTHERS = ("object", "floor", "bin", "rim")  # what else a flight or a posture comes close to
TOOL = "tool_"  # with a number: a capsule of the tool
SIZE_MIN_M = 1e-4  # [m] a thinner body is a typing error
SIZE_MAX_M = 1e3  # [m] so is a larger one: mostly it is in millimetres
CLEARANCE_MAX_M = 1.0  # [m]


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


def keep_out_shapes(table: Mapping[str, Any]) -> tuple[Solid, ...]:
    """Returns the keep-out shapes of the table `[surroundings]`.

    Raises:
        CellError: a field of one is refused, or two have the same name.
    """
    where = "surroundings.keep_out"
    found: dict[str, Solid] = {}
    for i, entry in enumerate(tables(table["keep_out"], where)):
        shape = _shape(entry, f"{where}[{i}].")
        name = shape.called(i)
        if name in found:
            raise CellError(f"{where}[{i}].name", name, "is what another one is called")
        found[name] = shape
    return tuple(found.values())


def _shape(entry: Mapping[str, Any], where: str) -> Solid:
    name = _name(entry, where)
    clearance_m = number(entry, "clearance_m", where, 0.0, CLEARANCE_MAX_M) if "clearance_m" in entry else None
    rest = {key: value for key, value in entry.items() if key not in ("name", "clearance_m")}
    if "shape" not in rest and "pose" not in rest:
        box = corners(rest, where)
        return Box(box.lower, box.upper, name, clearance_m)
    kind = choice({"shape": "box", **rest}, "shape", where, SIZES)
    rest = exactly({"shape": kind, **rest}, ("shape", "pose", *SIZES[kind]), where)
    pose = exactly(merge_defaults({"pose": rest["pose"]}, {"pose": POSE}, where)["pose"], tuple(POSE), f"{where}pose.")
    X = placement(pose, "position_m", "rotation_vector_rad", f"{where}pose.", SIZE_MAX_M)
    if kind == "box":
        return shape_of(kind, X, vector(rest, "size_m", where, 3, SIZE_MIN_M, SIZE_MAX_M), name, clearance_m)
    sizes = [number(rest, key, where, SIZE_MIN_M, SIZE_MAX_M) for key in SIZES[kind]]
    return shape_of(kind, X, np.array([*sizes, 0.0][:2]), name, clearance_m)


def _name(entry: Mapping[str, Any], where: str) -> str:
    name = entry.get("name", "")
    if "name" in entry and not (isinstance(name, str) and name.isprintable() and NAME_PATTERN.fullmatch(name)):
        raise CellError(f"{where}name", name, "must be 1 to 64 printable characters without , : ;")
    if name and (name in OTHERS or name.startswith(TOOL) or name in capsule_rows("ur5e")):
        raise CellError(f"{where}name", name, "is what something else is called in a plan")
    return name
