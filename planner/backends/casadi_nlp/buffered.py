"""casadi's functions called with numpy arrays through its buffers, past matrices of its own.

A call with arrays copies every one of them into a matrix, entry by entry: a tenth of a millisecond each way, which is
ten times what the function of one stage takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

KEPT = 256  # functions whose signatures are remembered: more than there are solvers


@dataclass(frozen=True, eq=False)
class _Signature:
    names: tuple[str, ...]  # of the arguments
    sizes: tuple[int, ...]  # of the arguments, all dense
    shapes: tuple[tuple[int, int], ...]  # of the results
    places: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]  # rows and columns of their nonzeros


@lru_cache(maxsize=KEPT)
def _signature(function: Any) -> _Signature:
    inputs, outputs = range(function.n_in()), range(function.n_out())
    return _Signature(
        names=tuple(function.name_in(i) for i in inputs),
        sizes=tuple(function.numel_in(i) for i in inputs),
        shapes=tuple(function.size_out(i) for i in outputs),
        places=tuple((np.array(rows), np.array(columns)) for rows, columns in (
            function.sparsity_out(i).get_triplet() for i in outputs
        )),
    )  # fmt: skip


def evaluate(function: Any, *arguments: Vector) -> list[Vector]:
    """Returns every result of a function, dense (rows, columns).

    Raises:
        ValueError: an argument has another size than the function takes.
    """
    known = _signature(function)
    _, results = _run(function, dict(zip(known.names, arguments, strict=True)), range(len(known.shapes)))
    return [_dense(*each) for each in zip(results, known.shapes, known.places, strict=True)]


def first_result(solver: Any, arguments: Mapping[str, Vector]) -> tuple[Vector, dict[str, Any]]:
    """Returns the first result (n,) of a solver that is called by names, and its statistics.

    Raises:
        ValueError: an argument is unknown, or has another size than the solver takes.
    """
    buffer, (result,) = _run(solver, arguments, range(1))
    return result, buffer.stats()


def _run(function: Any, arguments: Mapping[str, Vector], wanted: Sequence[int]) -> tuple[Any, list[Vector]]:
    known = _signature(function)
    buffer, trigger = function.buffer()
    inputs = {name: np.ascontiguousarray(value, dtype=np.float64) for name, value in arguments.items()}
    for name, value in inputs.items():
        i = known.names.index(name)
        if value.size != known.sizes[i]:
            raise ValueError(f"{function.name()}: {name} has {value.size} entries instead of {known.sizes[i]}")
        buffer.set_arg(i, value.data)
    results = [np.zeros(len(known.places[i][0])) for i in wanted]
    for i, result in zip(wanted, results, strict=True):
        buffer.set_res(i, result.data)
    trigger()
    return buffer, results


def _dense(nonzeros: Vector, shape: tuple[int, int], places: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Vector:
    dense = np.zeros(shape)
    dense[places] = nonzeros
    return dense
