"""Meshes that a cell file names: read by trimesh, covered with boxes, and kept in the user's cache by their content."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.cell.mesh_cover import MeshCover, cover
from planner.documents import read_file
from planner.errors import FileRefused

MESH_BYTES = 20_000_000  # [byte] of a mesh file: 400,000 faces in binary STL
MESH_KINDS = ("stl", "obj", "ply")
FILE_PATTERN = re.compile(
    rf"(?=.{{1,200}}$)([A-Za-z0-9_-][\w.-]*/)*[A-Za-z0-9_-][\w.-]*\.({'|'.join(MESH_KINDS)})", re.ASCII | re.I
)
FORMAT = 1  # of what is kept: another number makes all covers anew
UNREADABLE = (ValueError, LookupError, TypeError, AttributeError, ImportError, OverflowError, struct.error)


def mesh_names(document: Mapping[str, Any]) -> list[str]:
    """Returns the names of the mesh files that a cell file names, sorted; those that are no names are left out."""
    around = document.get("surroundings")
    entries = around.get("keep_out") if isinstance(around, Mapping) else None
    tables = [each for each in entries if isinstance(each, Mapping)] if isinstance(entries, list) else []
    named = [each.get("file") for each in tables if each.get("shape") == "mesh"]
    return sorted({name for name in named if isinstance(name, str) and FILE_PATTERN.fullmatch(name)})


def covers_of(folder: Path, names: list[str]) -> bytes | None:
    """Returns what becomes of the mesh files in a folder, as JSON by their names; None without names.

    That is `sha256`, `is_closed`, and `axes`, `lower`, `upper` and `beyond` of a `MeshCover`, or why one is `refused`.
    """
    found = {name: _kept(folder / name) for name in names}
    return json.dumps(found, sort_keys=True).encode() if found else None


def mesh_hashes(covers: bytes) -> dict[str, str | None]:
    """Returns the hashes of the mesh files among those of `covers_of`, by name; None of a file that is refused."""
    return {name: each.get("sha256") for name, each in json.loads(covers).items()}


def cover_in(covers: bytes | None, name: str) -> tuple[MeshCover, bool] | str:
    """Returns the cover of a mesh file among those of `covers_of`, and whether its surface is closed, or a refusal."""
    known = json.loads(covers or b"{}").get(name, {"refused": "cannot be read: put it beside the cell file"})
    if "refused" in known:
        return str(known["refused"])
    axes, lower, upper = (np.array(known[key]) for key in ("axes", "lower", "upper"))
    return MeshCover(axes, lower, upper, known["beyond"]), known["is_closed"]


def _kept(path: Path) -> dict[str, Any]:
    """Returns what becomes of a mesh file, from the cache or into it."""
    try:
        data = read_file(path, MESH_BYTES)
    except FileRefused as error:
        return {"refused": f"cannot be read: {error.reason}"}
    sha256 = hashlib.sha256(data).hexdigest()
    kind = path.suffix[1:].lower()
    cached = _cache() / f"{sha256}.{kind}.{FORMAT}.json"
    try:
        return dict(json.loads(cached.read_bytes()))
    except (OSError, ValueError):
        made = _made(data, kind, sha256)
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


def _made(data: bytes, kind: str, sha256: str) -> dict[str, Any]:
    try:
        triangles, is_closed = _triangles(data, kind)
    except UNREADABLE:
        return {"refused": f"is no mesh in {kind.upper()} format"}
    if not np.isfinite(triangles).all():
        return {"refused": "has corners that are no numbers"}
    if not len(triangles) or not np.ptp(triangles, axis=(0, 1)).any():
        return {"refused": "has no faces"}
    made = cover(triangles)
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
