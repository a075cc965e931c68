"""Grids: fields of a request that take several values, each by its path in the request, such as `release.position[0]`.

A grid is a mapping from paths to axes. An axis is `[from, to, step]` or `{"values": [...]}`. The last axis turns
fastest. A request of the grid is made when it is asked for, by its number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, overload

from planner.errors import ERRORS_MAX, FieldError, InvalidProblem
from planner.fields import Number, is_number, named, short_name

AXIS_MAX = 1_000_000  # values of one axis; more are a typing error in its step
STEP_SLACK = 1e-9  # [-] of a step by which the last value may miss `to`: 0.1 is no binary number
DIGITS = 12  # decimal places of a value: 0.1 + 2 * 0.1 is 0.3
NAME = r"[A-Za-z_][A-Za-z0-9_]*"
INDEX = r"\[\d{1,3}\]"
PATH = re.compile(rf"{NAME}(\.{NAME}|{INDEX})*")
PART = re.compile(rf"({NAME})|\[(\d+)\]")
RANGE = ("from", "to", "step")
AXIS = 'an axis is [from, to, step], or {"values": [...]} with at least one value'

T = TypeVar("T")


@dataclass(frozen=True)
class Axis:
    """One field of a grid: keys and indices that lead to it, and its values."""

    path: str
    keys: tuple[str | int, ...]
    values: Sequence[Any]


@dataclass(frozen=True)
class Steps(Sequence[float]):
    """The values of a range, each reckoned when it is asked for: a grid may have many long axes."""

    first: float
    step: float
    length: int

    def __len__(self) -> int:
        return self.length

    @overload
    def __getitem__(self, k: int) -> float: ...
    @overload
    def __getitem__(self, k: slice) -> list[float]: ...
    def __getitem__(self, k: int | slice) -> float | list[float]:
        """Returns value `k`, or those of a slice."""
        if isinstance(k, slice):
            return [self[i] for i in range(self.length)[k]]
        return round(self.first + range(self.length)[k] * self.step, DIGITS)


def axes_of(grid: Mapping[str, Any], template: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Returns the axes of a grid.

    Args:
        grid: axes by path.
        template: the request in which they are set.

    Raises:
        InvalidProblem: A path leads nowhere in the template, or an axis has no values; every such axis is named.
    """

    def axis(path: str, values: Any) -> Axis:
        made = Axis(path, _keys(path), _values(values))
        _with(template, made.keys, None)
        return made

    return tuple(_each(grid, axis))


def check_axes(grid: Mapping[str, Any]) -> None:
    """Checks that axes are a range or a list of values, whatever the template is.

    Raises:
        InvalidProblem: An axis is neither; every such axis is named.
    """
    _each(grid, lambda path, values: _values(values))


def _each(grid: Mapping[str, Any], made: Callable[[str, Any], T]) -> list[T]:
    """Returns what is made of each axis; names every one of which nothing can be."""
    found: list[T] = []
    errors: list[FieldError] = []
    for path, values in grid.items():
        try:
            found.append(made(path, values))
        except ValueError as error:
            if len(errors) == ERRORS_MAX:
                break
            errors.append(FieldError(f"grid.{short_name(path)}", str(error)))
    if errors:
        raise InvalidProblem(errors)
    return found


def request_at(template: Mapping[str, Any], axes: Sequence[Axis], number: int) -> dict[str, Any]:
    """Returns the request of a grid with this number, counted from 0."""
    request = dict(template)
    values = values_at(axes, number)
    for axis in axes:
        request = _with(request, axis.keys, values[axis.path])
    return request


def values_at(axes: Sequence[Axis], number: int) -> dict[str, Any]:
    """Returns the values of the axes in the request with this number, by path; the first axis first."""
    found: dict[str, Any] = {}
    for axis in reversed(axes):
        number, at = divmod(number, len(axis.values))
        found[axis.path] = axis.values[at]
    return {axis.path: found[axis.path] for axis in axes}


def is_numeric(axis: Axis) -> bool:
    """Returns whether every value of an axis is a number."""
    return isinstance(axis.values, Steps) or all(is_number(value) for value in axis.values)


def _keys(path: str) -> tuple[str | int, ...]:
    if PATH.fullmatch(path) is None:
        raise ValueError("is no path of a field such as release.position[0]")
    return tuple(name or int(index) for name, index in PART.findall(path))


def _values(axis: Any) -> Sequence[Any]:
    if isinstance(axis, Mapping):
        values = axis.get("values")
        if axis.keys() != {"values"} or not isinstance(values, list) or not values:
            raise ValueError(f"has other fields, or no values; {AXIS}")
        return values
    first, last, step = _range(axis)
    if step == 0.0 or (last - first) / step < 0.0:
        raise ValueError(f"a step of {step:g} does not lead from {first:g} to {last:g}")
    steps = (last - first) / step + STEP_SLACK
    if not steps < AXIS_MAX:  # also of a step that is next to nothing, which makes it infinite
        raise ValueError(f"has {steps + 1.0:.0f} values; an axis may have {AXIS_MAX}")
    return Steps(first, step, math.floor(steps) + 1)


def _range(axis: Any) -> list[float]:
    """Returns the three numbers of a range."""
    if not isinstance(axis, Sequence) or isinstance(axis, str):
        raise ValueError(f"is {named(axis)}; {AXIS}")
    if len(axis) != len(RANGE):
        raise ValueError(f"has {len(axis)} entries; {AXIS}")
    errors: list[FieldError] = []
    numbers = [Number().read(value, name, errors) for name, value in zip(RANGE, axis, strict=True)]
    if errors:
        raise ValueError("; ".join(f"{error.field} {error.reason}" for error in errors))
    return [number for number in numbers if number is not None]


def _with(at: Any, keys: Sequence[str | int], value: Any) -> Any:
    """Returns a copy with the field at the end of a path set; names that are absent on the way become objects."""
    key = keys[0]
    rest = keys[1:]
    if isinstance(key, int):
        if not isinstance(at, list) or key >= len(at):
            raise ValueError(f"the template has no element {key} there")
        return [*at[:key], _with(at[key], rest, value) if rest else value, *at[key + 1 :]]
    if not isinstance(at, Mapping):
        raise ValueError(f"the template has no object there that could have {key!r}")
    return {**at, key: _with(at.get(key, {}), rest, value) if rest else value}
