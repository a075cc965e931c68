"""Point clouds and depth pictures of what stands around an arm, as the full cells of a grid."""

from __future__ import annotations

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Box, Cell, full_cells, point_cloud
from planner.documents import read_file
from planner.errors import FileRefused
from planner.geometry import body_model, point_segment_distance, segment_shape_distance

SCAN_BYTES = 500_000_000  # [byte] of a file: 30 million points
MILLIMETRE = 0.001  # [m] a step of depth pictures, as cameras write them
PCD_TYPES = {"F": "f", "I": "i", "U": "u"}


class Scan(NamedTuple):
    """The full cells of a grid along the world's axes.

    Attributes:
        middles: of the cells (k, 3) [m].
        left_out: what was left out, in words.
    """

    middles: Array
    left_out: list[str]


def read_points(path: Path, intrinsics: tuple[float, ...] | None = None) -> Array:
    """Returns the points (n, 3) of a file: PLY, XYZ or PCD, or a depth picture (PNG of 16 bits).

    Those of a picture are in the camera's frame, x to the right, y down, z away from it, in steps of depth; 0 is none.

    Args:
        path: of the file.
        intrinsics: fx, fy, cx, cy [pixel] of the camera; of pictures alone.

    Raises:
        FileRefused: it cannot be read, or has no points.
    """
    data = read_file(path, SCAN_BYTES)
    kind = path.suffix[1:].lower()
    try:
        if kind == "png":
            points = _seen(data, intrinsics)
        elif kind == "pcd":
            points = _of_pcd(data)
        elif kind in ("ply", "xyz"):
            points = point_cloud(data, kind)
        else:
            raise ValueError("must be .ply, .xyz, .pcd, or a depth picture as .png")
    except ValueError as error:
        raise FileRefused(path, str(error)) from error
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise FileRefused(path, "has no points")
    return points


def _seen(data: bytes, intrinsics: tuple[float, ...] | None) -> Array:
    """Returns the points (n, 3) of a depth picture, in its steps."""
    if intrinsics is None:
        raise ValueError("is a picture: give the camera's --intrinsics")
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError as error:
        raise ValueError("needs Pillow: pip install 'fling-robotics[maps]'") from error
    try:
        image = Image.open(io.BytesIO(data))
        depth = np.array(image)
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise ValueError("is no picture in PNG format") from error
    if depth.ndim != 2 or not image.mode.startswith("I"):
        raise ValueError("is no depth picture: one grey channel of 16 bits")
    fx, fy, cx, cy = intrinsics
    v, u = np.nonzero(depth)
    z = depth[v, u].astype(np.float64)
    return np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1)


def _of_pcd(data: bytes) -> Array:
    """Returns the points (n, 3) of a file of the Point Cloud Library, version 0.7, ASCII or binary.

    Raises:
        ValueError: it is none, or compressed.
    """
    head, _, rest = data.partition(b"\nDATA ")
    encoding, _, body = rest.partition(b"\n")
    lines = (line.split() for line in head.decode("ascii", "replace").splitlines())
    header = {words[0]: words[1:] for words in lines if words}
    if encoding.strip() not in (b"ascii", b"binary"):
        raise ValueError("must be a PCD file with DATA ascii or binary")
    try:
        names = header["FIELDS"]
        count = int(header["POINTS"][0])
        types = [f"<{PCD_TYPES[kind]}{size}" for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
        counts = map(int, header.get("COUNT", ["1"] * len(names)))
        fields = [(f"{name}{i}", kind, n) for i, (name, kind, n) in enumerate(zip(names, types, counts, strict=True))]
        columns = [f"{axis}{names.index(axis)}" for axis in "xyz"]
        row = np.dtype(fields)
        if encoding.strip() == b"ascii":
            table = np.loadtxt(io.BytesIO(body), dtype=row, ndmin=1)
        else:
            table = np.frombuffer(body, row, count)
        return np.stack([np.asarray(table[name], np.float64).reshape(count) for name in columns], axis=1)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError("is no point cloud in PCD format") from error


def scanned(cell: Cell, points: Array, edge_m: float, within_m: float) -> Scan:
    """Returns the cells that points are in, without the floor, the arm and its tool at home, and what is far away.

    Args:
        cell: the cell.
        points: in the world (n, 3) [m].
        edge_m: of a cell of the grid.
        within_m: distance from the arm's base, beyond which points are left out.
    """
    around = cell.surroundings
    left_out = []
    near = np.linalg.norm(points - cell.X_WB[:3, 3], axis=1) <= within_m
    if not near.all():
        left_out.append(f"{(~near).sum()} points more than {within_m:g} m from the arm's base")
    middles = np.asarray((full_cells(points[near], edge_m) + 0.5) * edge_m, np.float64)
    on_floor = middles[:, 2] < around.floor_z_m + edge_m
    if on_floor.any():
        left_out.append(f"{on_floor.sum()} cells on the floor or below it, those within {edge_m:g} m above it too")
    middles = middles[~on_floor]
    seen = _within_clearance(cell, middles, edge_m)
    if seen.any():
        left_out.append(f"{seen.sum()} cells within the clearance of arm and tool at home, taken for the arm itself")
    return Scan(middles[~seen], left_out)


def _within_clearance(cell: Cell, middles: Array, edge_m: float) -> Mask:
    """Returns which cells (k,) with middles (k, 3) are within the clearance of the arm, or of its tool, at home."""
    body = body_model(cell)
    parts = slice(0, body.object)  # what it may hold is not there when a camera looks
    ends = body.end_points(body.link_poses(cell.home[None]))[parts, ..., 0]
    required = body.radii[parts] + cell.surroundings.clearance_m
    found = np.zeros(len(middles), np.bool_)
    for (p0, p1), radius in zip(ends, required, strict=True):
        close = point_segment_distance(middles, p0, p1) < radius + edge_m * np.sqrt(3.0)
        for i in np.flatnonzero(close & ~found):
            box = Box(middles[i] - 0.5 * edge_m, middles[i] + 0.5 * edge_m)
            found[i] = segment_shape_distance(p0, p1, box) <= radius
    return found


def points_ply(points: Array) -> bytes:
    """Returns points (n, 3) as a PLY file of doubles."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header = [*lines, *(f"property double {axis}" for axis in "xyz"), "end_header", ""]
    return "\n".join(header).encode() + np.ascontiguousarray(points, "<f8").tobytes()
