"""Array types of the planner, arrays that cannot be changed, and values without arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


def read_only(values: ArrayLike) -> Array:
    """Returns a read-only float64 copy of `values`."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def plain(value: Any, left_out: tuple[str, ...] = ()) -> Any:
    """Returns a value as JSON and cell files have it: arrays and numbers of numpy as Python's, dataclasses by field.

    Args:
        value: whatever it holds; what has no such form stays.
        left_out: fields of a dataclass that are left out.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value) if field.name not in left_out}
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(each) for each in value]
    as_list = getattr(value, "tolist", None)  # of numpy; a column of a pandas frame has it, too
    return value if as_list is None else as_list()
