"""Meshes and point clouds that a cell file names: read by trimesh, covered with boxes, kept in the user's cache.

What a cell file names is told by a key: the file's name, and behind it the edge of a grid's cells for points, or what
is made of a mesh that is not covered: the shape that encloses it (`ENCLOSED`), or the walls of a room (`WALLED`).
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, plain
from planner.cell.meshes.boxes import MeshCover, cover
from planner.cell.meshes.enclosing import EnclosingShape, enclosing
from planner.cell.meshes.points import points_cover
from planner.cell.meshes.walls import walls
from planner.documents import read_file
from planner.errors import FileRefused

MESH_BYTES = 20_000_000  # [byte] of a mesh file: 400,000 faces in binary STL
MESH_KINDS = ("stl", "obj", "ply")
FILE_PATTERN = re.compile(
    rf"(?=.{{1,200}}$)([A-Za-z0-9_-][\w.-]*/)*[A-Za-z0-9_-][\w.-]*\.({'|'.join(MESH_KINDS)})", re.ASCII | re.I
)
POINTS_PATTERN = re.compile(FILE_PATTERN.pattern.replace("|".join(MESH_KINDS), "ply"), re.ASCII | re.I)
CELL_M = 0.02  # [m] edge of the cells of a grid about points, unless a cell file says otherwise
FARTHEST = 1e9  # units of a corner from the origin: a thousand kilometres in millimetres
ENCLOSED = "enclosed"
WALLED = "walled"
FORMAT = 1  # of what is kept: another number makes all covers anew
UNREADABLE = (ValueError, LookupError, TypeError, AttributeError, ImportError, OverflowError, struct.error)


class EnclosedMesh(NamedTuple):
    """A mesh in a simple shape, and the volume that the mesh encloses; None of an open one."""

    shape: EnclosingShape
    volume: float | None


def cover_keys(document: Mapping[str, Any]) -> list[str]:
    """Returns the keys of what a cell file names, sorted; what is no name is left out."""
    around = _table(document, "surroundings")
    used = [(each, "") for each in (*_list(around, "keep_out"), *_list(_table(document, "tool"), "shapes"))]
    used += [(each, WALLED) for each in _list(around, "keep_in")]
    used.append((document.get("object"), ENCLOSED))
    return sorted({key for each, use in used if isinstance(each, Mapping) and (key := cover_key(each, use))})


def _table(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = document.get(name)
    return table if isinstance(table, Mapping) else {}


def _list(table: Mapping[str, Any], key: str) -> list[Any]:
    entries = table.get(key)
    return entries if isinstance(entries, list) else []


def cover_key(entry: Mapping[str, Any], use: str = "") -> str | None:
    """Returns the key of a mesh or of points; None of another shape, or a refused one.

    Args:
        entry: the table of the shape.
        use: `ENCLOSED` for the object, `WALLED` for `keep_in`, where no points stand; otherwise empty.
    """
    name = entry.get("file")
    pattern = {"mesh": FILE_PATTERN, "points": POINTS_PATTERN}.get(str(entry.get("shape")))
    if pattern is None or not isinstance(name, str) or not pattern.fullmatch(name):
        return None
    if entry["shape"] == "mesh":
        return f"{name} {use}" if use else name
    try:
        edge = float(entry.get("cell_m", CELL_M)) / float(entry.get("scale", 1.0))
    except (TypeError, ValueError, ArithmeticError):
        return None
    return f"{name} {edge!r}" if 0.0 < edge < math.inf and not use else None


def file_of(key: str) -> str:
    """Returns the name of the file that a key is of."""
    return key.split(" ")[0]


def covers_of(folder: Path, keys: Sequence[str]) -> bytes | None:
    """Returns what becomes of the files in a folder, as JSON by their keys; None without keys.

    That is `sha256`, `is_closed`, and `axes`, `lower`, `upper` and `beyond` of a `MeshCover`, or why one is `refused`.
    Of an enclosed one `shape`, an `EnclosingShape`, and `volume`, of a walled one `walls`, several covers.
    """
    found = {key: _kept(folder / file_of(key), *key.split(" ")[1:]) for key in keys}
    return json.dumps(found, sort_keys=True).encode() if found else None


def mesh_hashes(covers: bytes) -> dict[str, str | None]:
    """Returns the hashes of the files among those of `covers_of`, by name; None of a file that is refused."""
    return {file_of(key): each.get("sha256") for key, each in json.loads(covers).items()}


def cover_in(covers: bytes | None, key: str) -> tuple[MeshCover, bool] | str:
    """Returns the cover of a key among those of `covers_of`, and whether its surface is closed, or a refusal."""
    known = _known(covers, key)
    if "refused" in known:
        return str(known["refused"])
    return _cover(known), known["is_closed"]


def shape_in(covers: bytes | None, key: str) -> EnclosedMesh | str:
    """Returns what encloses the mesh of a key among those of `covers_of`, or a refusal."""
    known = _known(covers, key)
    if "refused" in known:
        return str(known["refused"])
    told = known["shape"]
    shape = EnclosingShape(**{**told, **{name: np.array(told[name]) for name in ("axes", "centre", "size")}})
    return EnclosedMesh(shape, known["volume"])


def walls_in(covers: bytes | None, key: str) -> list[MeshCover] | str:
    """Returns the boxes whose common part is the room of a key among those of `covers_of`, each, or a refusal."""
    known = _known(covers, key)
    if "refused" in known:
        return str(known["refused"])
    return [_cover(each) for each in known["walls"]]


def _known(covers: bytes | None, key: str) -> dict[str, Any]:
    return dict(json.loads(covers or b"{}").get(key, {"refused": "cannot be read: put it beside the cell file"}))


def _cover(known: Mapping[str, Any]) -> MeshCover:
    axes, lower, upper = (np.array(known[key]) for key in ("axes", "lower", "upper"))
    return MeshCover(axes, lower, upper, known["beyond"])


def _kept(path: Path, use: str = "") -> dict[str, Any]:
    """Returns what becomes of a mesh file, or of points in a grid, from the cache or into it; see `cover_key`."""
    try:
        data = read_file(path, MESH_BYTES)
    except FileRefused as error:
        return {"refused": f"cannot be read: {error.reason}"}
    sha256 = hashlib.sha256(data).hexdigest()
    kind = path.suffix[1:].lower()
    cached = _cache() / f"{sha256}.{kind}{use and f'-{use}'}.{FORMAT}.json"
    try:
        return dict(json.loads(cached.read_bytes()))
    except (OSError, ValueError):
        is_mesh = use in ("", ENCLOSED, WALLED)
        made = _made(data, kind, sha256, use) if is_mesh else _of_points(data, sha256, float(use))
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


def _made(data: bytes, kind: str, sha256: str, use: str) -> dict[str, Any]:
    try:
        triangles, is_closed, volume = _triangles(data, kind)
    except UNREADABLE:
        return {"refused": f"is no mesh in {kind.upper()} format"}
    if not (np.abs(triangles) <= FARTHEST).all():
        return {"refused": f"has corners that are no numbers, or farther than {FARTHEST:g} from its origin"}
    if not np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).any():
        return {"refused": "has no faces"}
    if use == ENCLOSED:
        return {"sha256": sha256, "shape": plain(enclosing(triangles)), "volume": volume}
    if use == WALLED:
        return _walled(triangles, is_closed, sha256)
    return _told(cover(triangles), sha256, is_closed)


def _walled(triangles: Array, is_closed: bool, sha256: str) -> dict[str, Any]:
    if not is_closed:
        return {"refused": "is not closed: nothing tells what is inside"}
    try:
        return {"sha256": sha256, "walls": plain(walls(triangles))}
    except ValueError as error:
        return {"refused": str(error)}


def _told(made: MeshCover, sha256: str, is_closed: bool) -> dict[str, Any]:
    arrays = {key: getattr(made, key).tolist() for key in ("axes", "lower", "upper")}
    return {"sha256": sha256, "is_closed": is_closed, **arrays, "beyond": made.beyond}


def _triangles(data: bytes, kind: str) -> tuple[Array, bool, float | None]:
    """Returns a mesh's faces by their corners (n, 3, 3), whether they are closed, and the volume that they enclose."""
    import trimesh

    mesh = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)
    triangles = np.array(mesh.triangles, dtype=np.float64)
    if not np.isfinite(triangles).all():
        return triangles, False, None
    mesh.merge_vertices()
    is_closed = bool(mesh.is_watertight)
    return triangles, is_closed, abs(float(mesh.volume)) if is_closed and mesh.is_winding_consistent else None
