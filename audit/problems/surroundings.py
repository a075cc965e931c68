"""Shapes about an arm, as entries of a cell file: walls and blocks, turned and round ones, meshes and points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from audit.problems.postures import state_of
from planner.cell import Cell

Vector = NDArray[np.float64]

KINDS = ("box", "turned box", "cylinder", "sphere", "capsule", "table", "wall") * 2 + ("mesh", "points")
CORNERS = 14  # [-] points that a mesh is the hull of
POINTS = 16  # of a cloud
CELL_M = 0.04  # [m] edges of the boxes about them


class Furniture:
    """Draws shapes about one cell's arm.

    Args:
        cell: the arm and its base.
        rng: of the draws.
    """

    def __init__(self, cell: Cell, rng: np.random.Generator) -> None:
        self._rng = rng
        self._base = cell.X_WB[:3, 3]
        self._reach = float(np.abs(cell.robot.a).sum())
        self._hand = state_of(cell, cell.home, np.zeros(6)).X_WT.translation

    def room(self) -> dict[str, Any]:
        """Returns a keep-in shape about the tool at home."""
        rng = self._rng
        kind = str(rng.choice(["corners", "cylinder", "sphere"]))
        half = rng.uniform(0.6, 1.2, 3) * self._reach
        if kind == "corners":
            return {"lower_m": (self._hand - half).tolist(), "upper_m": (self._hand + half).tolist()}
        sizes = {"radius_m": float(half[0])} | ({"length_m": 2.0 * float(half[1])} if kind == "cylinder" else {})
        return {"shape": kind, "pose": {"position_m": self._hand.tolist()}, **sizes}

    def with_room(self, keys: Mapping[str, Any], entry: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the keys of a cell with a keep-in shape."""
        return {**keys, "surroundings": {**keys["surroundings"], "keep_in": [entry]}}

    def with_shape(self, keys: Mapping[str, Any], entry: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the keys of a cell with one more keep-out shape."""
        around = keys["surroundings"]
        return {**keys, "surroundings": {**around, "keep_out": [*around.get("keep_out", []), entry]}}

    def shape(self, number: int) -> tuple[dict[str, Any], dict[str, bytes]]:
        """Returns a keep-out shape, and the files that it names.

        Args:
            number: of the shape; it stands in the name of a file.
        """
        rng = self._rng
        kind = str(rng.choice(KINDS))
        place = self._base + rng.uniform(-1.0, 1.0, 3) * self._reach
        size = rng.uniform(0.05, 0.4, 3) * self._reach
        entry, beside = self._of_kind(kind, place, size, number)
        if rng.random() < 0.2:
            entry["clearance_m"] = float(rng.uniform(0.0, 0.04))
        return entry, beside

    def _of_kind(self, kind: str, place: Vector, size: Vector, number: int) -> tuple[dict[str, Any], dict[str, bytes]]:
        rng = self._rng
        turned = {"position_m": place.tolist(), "rotation_vector_rad": rng.uniform(-1.5, 1.5, 3).tolist()}
        match kind:
            case "box" | "table" | "wall":
                return self._along_axes(kind, place, size), {}
            case "turned box":
                return {"shape": "box", "pose": turned, "size_m": size.tolist()}, {}
            case "sphere":
                return {"shape": "sphere", "pose": turned, "radius_m": 0.5 * float(size[0])}, {}
            case "mesh":
                file = f"mesh-{number}.stl"
                return {"shape": "mesh", "pose": turned, "file": file}, {file: self._hull(size)}
            case "points":
                file = f"points-{number}.ply"
                cloud = place + rng.uniform(-0.5, 0.5, (POINTS, 3)) * size * [1.0, 1.0, 0.3]
                return {"shape": "points", "file": file, "cell_m": CELL_M}, {file: _ply(cloud)}
            case _:
                sizes = {"radius_m": 0.3 * float(size[0]), "length_m": 2.0 * float(size[1])}
                return {"shape": kind, "pose": turned, **sizes}, {}

    def _along_axes(self, kind: str, place: Vector, size: Vector) -> dict[str, Any]:
        """Returns a block, a table on the floor, or a wall beside the arm."""
        half = 0.5 * size
        if kind == "table":
            height = float(self._rng.uniform(0.1, 0.5))
            place = np.array([place[0], place[1], 0.5 * height])
            half = np.array([1.5 * half[0] + 0.1, 1.5 * half[1] + 0.1, 0.5 * height])
        if kind == "wall":
            side = int(self._rng.integers(2))
            place[side] = self._base[side] + self._rng.choice([-1.0, 1.0]) * self._rng.uniform(0.6, 1.2) * self._reach
            half = np.full(3, self._reach)
            half[side] = 0.03
        return {"lower_m": (place - half).tolist(), "upper_m": (place + half).tolist()}

    def _hull(self, size: Vector) -> bytes:
        """Returns a convex mesh about the origin as STL."""
        corners = self._rng.normal(size=(CORNERS, 3))
        corners *= 0.5 * size / np.linalg.norm(corners, axis=1, keepdims=True)
        hull = trimesh.Trimesh(vertices=corners).convex_hull
        hull.apply_translation(-hull.bounds.mean(axis=0))
        content = hull.export(file_type="stl")
        assert isinstance(content, bytes)
        return content


def _ply(points: Vector) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    return (head + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())).encode()
