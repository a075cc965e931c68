"""Shapes of scenes as entries of `keep_out`, written into a cell file."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from planner.cell import is_reserved
from planner.documents import toml_text
from planner.rotations import matrix_to_rotation_vector
from planner.scenes.foreign import DIGITS, ForeignShape

INLINE = re.compile(r"(?m)^[ \t]*keep_out[ \t]*=[ \t]*\[")  # of `[surroundings]`, which alone has such a key
NO_NAME = re.compile(r"[^\x20-\x2b\x2d-\x39\x3c-\x7e]")  # , : ; and what is not printed everywhere
NAME_MAX = 50  # characters; a number may follow


def entries_of(shapes: Sequence[ForeignShape], files: Sequence[str], taken: Collection[str]) -> list[dict[str, str]]:
    """Returns the entries of shapes: keys, and values as TOML writes them.

    Args:
        shapes: the shapes.
        files: names of their mesh files, as many; empty of other shapes.
        taken: names that other shapes have.
    """
    used = set(taken)
    found = []
    for shape, file in zip(shapes, files, strict=True):
        plain = _plain_name(shape)
        name = plain
        while name in used:
            name = f"{plain} {len(used)}"
        used.add(name)
        place, turn = _placed(shape)
        turned = f", rotation_vector_rad = {toml_text(turn)}" if any(turn) else ""
        placed = f"{{ position_m = {toml_text(place)}{turned} }}"
        keys = {"name": name, "shape": shape.kind, **({"file": file} if file else {}), **shape.keys}
        found.append({**{key: toml_text(value) for key, value in keys.items()}, "pose": placed})
    return found


def not_there(
    shapes: Sequence[ForeignShape], tables: Sequence[Mapping[str, Any]], meshes: Mapping[str, bytes]
) -> tuple[list[ForeignShape], list[str]]:
    """Returns the shapes that a cell does not have yet, and the names of those that it has.

    It has a shape that is called so, or so with a number, and is of the same kind, size and pose; each once.

    Args:
        shapes: the shapes.
        tables: entries of the cell's `keep_out`.
        meshes: contents of the files that these name.
    """
    left = list(tables)
    new = []
    there = []
    for shape in shapes:
        same = next((table for table in left if _is_same(shape, table, meshes)), None)
        if same is None:
            new.append(shape)
        else:
            left.remove(same)
            there.append(str(same["name"]))
    return new, there


def _is_same(shape: ForeignShape, table: Mapping[str, Any], meshes: Mapping[str, bytes]) -> bool:
    """Returns whether an entry of `keep_out` is what a shape would become."""
    called = re.fullmatch(re.escape(_plain_name(shape)) + r"( \d+)?", str(table.get("name")))
    if not called or table.get("shape") != shape.kind or "pose" not in table:
        return False
    placed = table["pose"]
    if (placed["position_m"], placed.get("rotation_vector_rad", [0.0] * 3)) != _placed(shape):
        return False
    if shape.mesh is not None and meshes.get(table["file"]) != shape.mesh[0]:
        return False
    return all(table.get(key, 1.0) == value for key, value in shape.keys.items())  # a mesh without a scale has 1


def _plain_name(shape: ForeignShape) -> str:
    """Returns the name of a shape as a cell file may have it."""
    plain = NO_NAME.sub("_", shape.name).strip()[:NAME_MAX].strip() or shape.kind
    return f"scene {plain}" if is_reserved(plain) else plain


def _placed(shape: ForeignShape) -> tuple[list[float], list[float]]:
    """Returns position [m] and rotation vector [rad] of a shape as a cell file has them."""
    return _rounded(shape.X[:3, 3]), _rounded(matrix_to_rotation_vector(shape.X[:3, :3]))


def with_entries(text: str, entries: Sequence[Mapping[str, str]], where: str) -> str:
    """Returns the text of a cell file with more entries of `keep_out`.

    Args:
        text: of the cell file.
        entries: see `entries_of`.
        where: they come from, for a comment.
    """
    tables = [[f"{key} = {value}" for key, value in entry.items()] for entry in entries]
    found = INLINE.search(text)
    if found is None:
        added = [line for table in tables for line in ("", "[[surroundings.keep_out]]", *table)]
        return "\n".join([text.rstrip("\n"), "", f"# from {where}", *added, ""])
    inline = "".join(f"    {{ {', '.join(table)} }},\n" for table in tables)
    return (
        f"{text[: found.end()]}  # the first {len(tables)} are from {where}\n{inline}{text[found.end() :].lstrip(' ')}"
    )


def _rounded(values: Any) -> list[float]:
    return [round(float(x), DIGITS) + 0.0 for x in values]
