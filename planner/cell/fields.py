"""Typed fields of a TOML table: every reader checks type, finiteness and bounds, and names the refused field.

Arguments that all readers share: `table` is the parsed table, `key` the field's name in it, `where` the dotted path of
the table with a trailing dot, used in error messages.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from typing import Any

from planner.arrays import Array, read_only
from planner.errors import CellError
from planner.fields import did_you_mean
from planner.rotations import beyond_full_turn, pose, rotation_vector_to_matrix

UNKNOWN_KEY = "unknown key"  # how its reason begins
LIMIT_MIN = 1e-6  # [any unit] smallest limit that is accepted: a limit of zero forbids every motion


class TablesByName(dict[str, Any]):
    """Default of a table of tables whose names are free, all with the same keys; it is empty."""

    def __init__(self, each: Mapping[str, Any]) -> None:
        """Takes the defaults of each table."""
        super().__init__()
        self.each = each

    def __missing__(self, name: str) -> Mapping[str, Any]:
        return self.each


def merge_defaults(given: Mapping[str, Any], defaults: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Returns `given` with missing keys filled in from `defaults`, in nested tables too.

    Raises:
        CellError: a key is not in `defaults`, or a value stands in place of a table.
    """
    for key in given:
        if key not in defaults:
            meant = did_you_mean(key, sorted(defaults)) or f"; known are {', '.join(sorted(defaults))}"
            raise CellError(where + key, None, f"{UNKNOWN_KEY}{meant}")
    merged: dict[str, Any] = {}
    for key, default in defaults.items():
        value = given.get(key, default)
        if isinstance(default, Mapping):
            if not isinstance(value, Mapping):
                raise CellError(where + key, value, "must be a table")
            if isinstance(default, TablesByName):
                default = dict.fromkeys(value, default.each)
            value = merge_defaults(value, default, f"{where}{key}.")
        merged[key] = value
    return merged


def number(table: Mapping[str, Any], key: str, where: str, lower: float = -math.inf, upper: float = math.inf) -> float:
    """Returns `table[key]` as a finite float inside [lower, upper].

    Raises:
        CellError: the value is missing, not a number, not finite, or out of bounds.
    """
    return _checked(table[key], where + key, lower, upper)


def optional(table: Mapping[str, Any], key: str, where: str, upper: float) -> float | None:
    """Returns a number above 0 and up to `upper`; None where it is absent."""
    return None if table[key] is None else number(table, key, where, LIMIT_MIN, upper)


def vector(
    table: Mapping[str, Any], key: str, where: str, size: int, lower: float = -math.inf, upper: float = math.inf
) -> Array:
    """Returns `table[key]` as a read-only float vector of `size` finite entries inside [lower, upper].

    Raises:
        CellError: the value is not a list of this size, or an entry is not a finite number within the bounds.
    """
    value = table[key]
    if not isinstance(value, list | tuple) or len(value) != size:
        raise must_be(f"a list of {size} numbers", where + key, value)
    return read_only([_checked(entry, f"{where}{key}[{i}]", lower, upper) for i, entry in enumerate(value)])


def placement(
    table: Mapping[str, Any], position: str, rotation: str, where: str, farthest_m: float = math.inf
) -> Array:
    """Returns a pose (4, 4) of which no coordinate is farther from the origin than `farthest_m` [m].

    Args:
        table, where: as of all readers.
        position, rotation: names of its fields.
        farthest_m: largest coordinate [m].

    Raises:
        CellError: one of them is refused.
    """
    p = vector(table, position, where, 3, -farthest_m, farthest_m)
    turn = vector(table, rotation, where, 3)
    if reason := beyond_full_turn(turn):
        raise CellError(where + rotation, turn.tolist(), reason)
    return read_only(pose(p, rotation_vector_to_matrix(turn)))


def per_joint(table: Mapping[str, Any], key: str, where: str, own: Array) -> Array:
    """Returns a limit (n,) given as one number or one per joint, above 0 and at most the arm's `own` (n,).

    Raises:
        CellError: a limit exceeds the arm's own, or is not above 0.
    """
    value = table[key]
    entries = value if isinstance(value, list | tuple) else [value] * len(own)
    if len(entries) != len(own):
        raise CellError(where + key, value, f"must be one number or {len(own)} of them")
    limits = [_checked(entry, f"{where}{key}[{i}]", 0.0, math.inf) for i, entry in enumerate(entries)]
    for i, (limit, bound) in enumerate(zip(limits, own, strict=True)):
        if limit > bound:
            raise beyond_arm(f"{where}{key}[{i}]", limit, bound)
        if limit <= 0.0:
            raise CellError(f"{where}{key}[{i}]", limit, "must be above 0")
    return read_only(limits)


def beyond_arm(field: str, value: float, own: float) -> CellError:
    """Returns the refusal of a limit beyond the arm's own."""
    return CellError(field, value, f"is beyond the arm's own limit of {own:.6g}")


def choice(table: Mapping[str, Any], key: str, where: str, allowed: Iterable[str]) -> str:
    """Returns `table[key]`, one of the `allowed` words.

    Raises:
        CellError: it is not one of them.
    """
    names = tuple(allowed)
    if table[key] not in names:
        raise must_be(f"one of {', '.join(names)}{did_you_mean(table[key], names)}", where + key, table[key])
    return str(table[key])


def must_be(what: str, field: str, value: object) -> CellError:
    """Returns the refusal of a value that is not what it must be; None: the key is missing."""
    return CellError(field, value, f"must be {what}" if value is not None else f"is missing: it must be {what}")


def tables(value: object, field_name: str) -> list[Mapping[str, Any]]:
    """Returns `value` as a list of tables.

    Raises:
        CellError: it is not a list of tables.
    """
    if not isinstance(value, list) or not all(isinstance(entry, Mapping) for entry in value):
        raise CellError(field_name, value, "must be a list of tables")
    return value


def exactly(entry: Mapping[str, Any], keys: tuple[str, ...], where: str) -> Mapping[str, Any]:
    """Returns `entry` after checking that it has exactly these `keys`.

    Raises:
        CellError: a key is unknown, or missing; the unknown one is named first, as it may be a misspelling.
    """
    merge_defaults(entry, dict.fromkeys(keys), where)
    for key in keys:
        if key not in entry:
            raise CellError(where + key, None, "is missing")
    return entry


def _checked(value: object, field: str, lower: float, upper: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise must_be("a number", field, value)
    if not abs(value) <= sys.float_info.max:
        raise CellError(field, value, "must be finite")
    if not lower <= value <= upper:
        raise CellError(field, value, f"must lie in [{lower:.6g}, {upper:.6g}]")
    return float(value)
