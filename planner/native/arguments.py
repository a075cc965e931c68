"""Arrays as arguments of C, which sees no bounds: shapes and indices are checked here."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from planner.arrays import Array, Index

COPIED_MAX = 4096  # [-] numbers that are copied in less time than their address takes
MEMORY = ctypes.c_char * 0  # of an array: its address


class Pinned:
    """Arrays that C reads in place again and again: their addresses are looked up once.

    Attributes:
        arrays: as given, contiguous.
    """

    def __init__(self, *arrays: Array) -> None:
        """Takes arrays of doubles, which must not change."""
        self.arrays = tuple(np.ascontiguousarray(values, dtype=np.float64) for values in arrays)
        self._shapes = [values.shape for values in self.arrays]
        self._addresses = [values.ctypes.data for values in self.arrays]

    def __reduce__(self) -> tuple[type[Pinned], tuple[Array, ...]]:
        """Returns how to copy it: a copy's arrays lie elsewhere."""
        return Pinned, self.arrays

    def of_shapes(self, *shapes: tuple[int, ...]) -> list[int]:
        """Returns the addresses of the arrays.

        Raises:
            ValueError: the arrays have other shapes.
        """
        if self._shapes != list(shapes):
            raise ValueError(f"arrays of the kernel are {self._shapes} instead of {shapes}")
        return self._addresses


def read(values: Array, shape: tuple[int, ...]) -> bytes | int:
    """Returns an argument: a copy, or the address of a large array, which takes 2 us; the caller holds the array.

    Raises:
        ValueError: it has another shape, or does not hold doubles.
    """
    if values.shape != shape or values.dtype.char != "d":
        raise ValueError(f"an array of the kernel is {values.dtype} {values.shape} instead of float64 {shape}")
    is_copied = values.size < COPIED_MAX or not values.flags.c_contiguous
    return values.tobytes() if is_copied else values.ctypes.data


def indices(values: Index, shape: tuple[int, ...], count: int) -> bytes:
    """Returns a copy of indices of rows.

    Raises:
        ValueError: they have another shape or type.
        IndexError: one is not a row of `count`.
    """
    if values.shape != shape or values.dtype != np.intp:
        raise ValueError(f"indices of the kernel are {values.dtype} {values.shape} instead of {shape}")
    if values.size and np.maximum.reduce(values.ravel().view(np.uintp)) >= count:  # a negative one is larger than any
        raise IndexError(f"an index of the kernel is outside [0, {count})")
    return values.tobytes()


def written(values: Array | Index) -> ctypes.Array[Any]:
    """Returns an argument that C writes to."""
    return MEMORY.from_buffer(values.data)
