"""Values of a script that are no plain Python numbers, strings or lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class ScriptPose(list[float]):
    """A pose p[x, y, z, rx, ry, rz]: position [m] and rotation vector [rad]."""

    def __init__(self, values: Sequence[Any]) -> None:
        """Checks the six numbers.

        Raises:
            ValueError: they are not six.
            TypeError: one is no number.
        """
        if len(values) != 6:
            raise ValueError(f"a pose has six numbers, not {len(values)}")
        super().__init__(number(value) for value in values)

    def __repr__(self) -> str:
        return f"p[{', '.join(map(written, self))}]"


def number(value: Any) -> float:
    """Returns a value that must be a number.

    Raises:
        TypeError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{written(value)} is no number")
    return value


def six(value: Any) -> list[float]:
    """Returns a value that must be a list of six numbers.

    Raises:
        TypeError, ValueError: it is none.
    """
    if not isinstance(value, list) or len(value) != 6:
        raise ValueError(f"{written(value)} is no list of six numbers")
    return [float(number(item)) for item in value]


def written(value: Any) -> str:
    """Returns a value as the controller writes it: six significant digits."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list) and not isinstance(value, ScriptPose):
        return f"[{', '.join(map(written, value))}]"
    return str(value)


def item(value: Any) -> Any:
    """Returns a value that may be an item of a list: lists nest once, as the rows of a matrix.

    Raises:
        ValueError: it is a list of lists.
    """
    if isinstance(value, list) and any(isinstance(inner, list) for inner in value):
        raise ValueError("lists are nested too deep")
    return value
