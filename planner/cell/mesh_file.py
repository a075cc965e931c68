"""Meshes and point clouds that a cell file names: read by trimesh, covered with boxes, kept in the user's cache.

What a cell file names is told by a key: the file's name, and behind it the edge of a grid's cells for points.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import struct
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.cell.mesh_cover import MeshCover, cover
from planner.cell.point_cover import points_cover
from planner.documents import read_file
from planner.errors import FileRefused

MESH_BYTES = 20_000_000  # [byte] of a mesh file: 400,000 faces in binary STL
MESH_KINDS = ("stl", "obj", "ply")
FILE_PATTERN = re.compile(
    rf"(?=.{{1,200}}$)([A-Za-z0-9_-][\w.-]*/)*[A-Za-z0-9_-][\w.-]*\.({'|'.join(MESH_KINDS)})", re.ASCII | re.I
)
POINTS_PATTERN = re.compile(FILE_PATTERN.pattern.replace("|".join(MESH_KINDS), "ply"), re.ASCII | re.I)
CELL_M = 0.02  # [m] edge of the cells of a grid about points, unless a cell file says otherwise
FORMAT = 1  # of what is kept: another number makes all covers anew
UNREADABLE = (ValueError, LookupError, TypeError, AttributeError, ImportError, OverflowError, struct.error)


def cover_keys(document: Mapping[str, Any]) -> list[str]:
    """Returns the keys of what a cell file names, sorted; what is no name is left out."""
    places = (("surroundings", "keep_out"), ("tool", "shapes"))
    lists = (table.get(key) for name, key in places if isinstance(table := document.get(name), Mapping))
    entries = chain.from_iterable(each for each in lists if isinstance(each, list))
    return sorted({key for each in entries if isinstance(each, Mapping) and (key := cover_key(each)) is not None})


def cover_key(entry: Mapping[str, Any]) -> str | None:
    """Returns the key of a mesh or of points, of `keep_out` or the tool; None of another shape, or a refused one."""
    name = entry.get("file")
    pattern = {"mesh": FILE_PATTERN, "points": POINTS_PATTERN}.get(str(entry.get("shape")))
    if pattern is None or not isinstance(name, str) or not pattern.fullmatch(name):
        return None
    if entry["shape"] == "mesh":
        return name
    try:
        edge = float(entry.get("cell_m", CELL_M)) / float(entry.get("scale", 1.0))
    except (TypeError, ValueError, ArithmeticError):
        return None
    return f"{name} {edge!r}" if 0.0 < edge < math.inf else None


def file_of(key: str) -> str:
    """Returns the name of the file that a key is of."""
    return key.split(" ")[0]


def covers_of(folder: Path, keys: list[str]) -> bytes | None:
    """Returns what becomes of the files in a folder, as JSON by their keys; None without keys.

    That is `sha256`, `is_closed`, and `axes`, `lower`, `upper` and `beyond` of a `MeshCover`, or why one is `refused`.
    """
    found = {key: _kept(folder / file_of(key), *key.split(" ")[1:]) for key in keys}
    return json.dumps(found, sort_keys=True).encode() if found else None


def mesh_hashes(covers: bytes) -> dict[str, str | None]:
    """Returns the hashes of the files among those of `covers_of`, by name; None of a file that is refused."""
    return {file_of(key): each.get("sha256") for key, each in json.loads(covers).items()}


def cover_in(covers: bytes | None, key: str) -> tuple[MeshCover, bool] | str:
    """Returns the cover of a key among those of `covers_of`, and whether its surface is closed, or a refusal."""
    known = json.loads(covers or b"{}").get(key, {"refused": "cannot be read: put it beside the cell file"})
    if "refused" in known:
        return str(known["refused"])
    axes, lower, upper = (np.array(known[key]) for key in ("axes", "lower", "upper"))
    return MeshCover(axes, lower, upper, known["beyond"]), known["is_closed"]


def _kept(path: Path, edge: str = "") -> dict[str, Any]:
    """Returns what becomes of a mesh file, or of points in a grid of an edge, from the cache or into it."""
    try:
        data = read_file(path, MESH_BYTES)
    except FileRefused as error:
        return {"refused": f"cannot be read: {error.reason}"}
    sha256 = hashlib.sha256(data).hexdigest()
    kind = path.suffix[1:].lower()
    cached = _cache() / f"{sha256}.{kind}{edge and f'-{edge}'}.{FORMAT}.json"
    try:
        return dict(json.loads(cached.read_bytes()))
    except (OSError, ValueError):
        made = _of_points(data, sha256, float(edge)) if edge else _made(data, kind, sha256)
    try:
        cached.parent.mkdir(parents=True, exist_ok=True)
        fresh = cached.with_suffix(f".{os.getpid()}")
        fresh.write_text(json.dumps(made))
        fresh.replace(cached)  # whoever reads it finds all of it
    except OSError:
        pass  # it is made again the next time
    return made


def _cache() -> Path:
    """Returns `fling/meshes` in the user's cache folder (XDG base directories)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fling" / "meshes"


def _of_points(data: bytes, sha256: str, edge: float) -> dict[str, Any]:
    try:
        return _told(points_cover(point_cloud(data, "ply"), edge), sha256, True)
    except ValueError as error:
        return {"refused": str(error)}


def point_cloud(data: bytes, kind: str) -> Array:
    """Returns the points (n, 3) of a file, those that are no numbers left out.

    Args:
        data: content of the file.
        kind: ply or xyz.

    Raises:
        ValueError: it is no such file, has no points, or has faces.
    """
    import trimesh

    try:
        known = trimesh.load(io.BytesIO(data), file_type=kind, process=False)
        vertices = known.vertices if isinstance(known, trimesh.PointCloud | trimesh.Trimesh) else ()
        points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    except UNREADABLE as error:
        raise ValueError(f"is no point cloud in {kind.upper()} format") from error
    if len(getattr(known, "faces", ())):
        raise ValueError('has faces: its shape is "mesh"')
    return points[np.isfinite(points).all(axis=1)]


def _made(data: bytes, kind: str, sha256: str) -> dict[str, Any]:
    try:
        triangles, is_closed = _triangles(data, kind)
    except UNREADABLE:
        return {"refused": f"is no mesh in {kind.upper()} format"}
    if not np.isfinite(triangles).all():
        return {"refused": "has corners that are no numbers"}
    if not len(triangles) or not np.ptp(triangles, axis=(0, 1)).any():
        return {"refused": "has no faces"}
    return _told(cover(triangles), sha256, is_closed)


def _told(made: MeshCover, sha256: str, is_closed: bool) -> dict[str, Any]:
    arrays = {key: getattr(made, key).tolist() for key in ("axes", "lower", "upper")}
    return {"sha256": sha256, "is_closed": is_closed, **arrays, "beyond": made.beyond}


def _triangles(data: bytes, kind: str) -> tuple[Array, bool]:
    """Returns the corners of a mesh's faces (n, 3, 3), and whether they are a closed surface."""
    import trimesh

    mesh = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)
    triangles = np.array(mesh.triangles, dtype=np.float64)
    if not np.isfinite(triangles).all():
        return triangles, False
    mesh.merge_vertices()
    return triangles, bool(mesh.is_watertight)
