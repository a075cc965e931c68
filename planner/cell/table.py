"""Reading one table of a cell file: types, finiteness, bounds and unknown keys, each refusal naming its field.

The reader keeps the numbers as written, so that `GET /cells/{name}` can answer them unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import CellError

Vector = NDArray[np.float64]


def merge_defaults(given: Mapping[str, Any], defaults: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Returns `given` with every missing key of `defaults` filled in, tables inside tables too.

    Raises:
        CellError: a key that `defaults` does not know, or a value where a table belongs.
    """
    for key in given:
        if key not in defaults:
            raise CellError(where + key, None, f"unknown key; known are {', '.join(sorted(defaults))}")
    merged: dict[str, Any] = {}
    for key, default in defaults.items():
        value = given.get(key, default)
        if isinstance(default, Mapping):
            if not isinstance(value, Mapping):
                raise CellError(where + key, value, "must be a table")
            value = merge_defaults(value, default, f"{where}{key}.")
        merged[key] = value
    return merged


def number(table: Mapping[str, Any], key: str, where: str, lower: float = -math.inf, upper: float = math.inf) -> float:
    """Returns `table[key]` as a finite float inside [lower, upper].

    Raises:
        CellError: not a number, not finite, or out of bounds.
    """
    return _checked(table[key], where + key, lower, upper)


def vector(
    table: Mapping[str, Any], key: str, where: str, size: int, lower: float = -math.inf, upper: float = math.inf
) -> Vector:
    """Returns `table[key]` as a read-only float vector of `size` finite entries inside [lower, upper].

    Raises:
        CellError: not a list, of another length, or an entry that `number` would refuse.
    """
    value = table[key]
    if not isinstance(value, list | tuple) or len(value) != size:
        raise CellError(where + key, value, f"must be a list of {size} numbers")
    return frozen([_checked(entry, f"{where}{key}[{i}]", lower, upper) for i, entry in enumerate(value)])


def per_joint(table: Mapping[str, Any], key: str, where: str, own: Vector, lower: float = 0.0) -> Vector:
    """Returns a limit given as one number or one a joint, at most the arm's `own`, above `lower`.

    Raises:
        CellError: a limit beyond the arm's own, or not above `lower`.
    """
    value = table[key]
    entries = value if isinstance(value, list | tuple) else [value] * len(own)
    if len(entries) != len(own):
        raise CellError(where + key, value, f"must be one number or {len(own)} of them")
    limits = [_checked(entry, f"{where}{key}[{i}]", lower, math.inf) for i, entry in enumerate(entries)]
    for i, (limit, bound) in enumerate(zip(limits, own, strict=True)):
        if limit > bound:
            raise CellError(f"{where}{key}[{i}]", limit, f"is beyond the arm's own limit of {bound:.6g}")
        if limit <= lower:
            raise CellError(f"{where}{key}[{i}]", limit, f"must be above {lower:.6g}")
    return frozen(limits)


def choice(table: Mapping[str, Any], key: str, where: str, allowed: Iterable[str]) -> str:
    """Returns `table[key]`, one of the `allowed` words.

    Raises:
        CellError: another word.
    """
    names = tuple(allowed)
    if table[key] not in names:
        raise CellError(where + key, table[key], f"must be one of {', '.join(names)}")
    return str(table[key])


def frozen(values: Any) -> Vector:
    """Returns `values` as a read-only float64 array."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def tables(value: object, field_name: str) -> list[Mapping[str, Any]]:
    """Returns `value`, a list of tables.

    Raises:
        CellError: anything else.
    """
    if not isinstance(value, list) or not all(isinstance(entry, Mapping) for entry in value):
        raise CellError(field_name, value, "must be a list of tables")
    return value


def exactly(entry: Mapping[str, Any], keys: tuple[str, ...], where: str) -> Mapping[str, Any]:
    """Returns `entry`, which has these `keys` and no other.

    Raises:
        CellError: a key is missing or unknown.
    """
    for key in keys:
        if key not in entry:
            raise CellError(where + key, None, "is missing")
    merge_defaults(entry, dict.fromkeys(keys), where)
    return entry


def _checked(value: object, field: str, lower: float, upper: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CellError(field, value, "must be a number")
    if not math.isfinite(value):
        raise CellError(field, value, "must be finite")
    if not lower <= value <= upper:
        raise CellError(field, value, f"must lie in [{lower:.6g}, {upper:.6g}]")
    return float(value)
