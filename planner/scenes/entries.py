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
        plain = NO_NAME.sub("_", shape.name).strip()[:NAME_MAX].strip() or shape.kind
        plain = f"scene {plain}" if is_reserved(plain) else plain
        name = plain
        while name in used:
            name = f"{plain} {len(used)}"
        used.add(name)
        turn = _rounded(matrix_to_rotation_vector(shape.X[:3, :3]))
        turned = f", rotation_vector_rad = {toml_text(turn)}" if any(turn) else ""
        placed = f"{{ position_m = {toml_text(_rounded(shape.X[:3, 3]))}{turned} }}"
        keys = {"name": name, "shape": shape.kind, **({"file": file} if file else {}), **shape.keys}
        found.append({**{key: toml_text(value) for key, value in keys.items()}, "pose": placed})
    return found


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
