"""Calls of fatrop with the rows of the extension `planner.native`.

Its `launch.c` hands fatrop each stage's matrices, two stages at once. It finds the numbers of casadi's own interface to
the last bit; that one evaluates the whole problem as sparse matrices and takes them apart again for every stage, which
takes as long as the rows themselves.

A call is ended whose release would be too late. Of a convex problem, the Lagrangian at the multipliers of an iteration,
less the most by which other values of the variables and rows within their bounds could lower it, is no larger than the
least cost (weak duality). These problems are not convex, and the other terms of the cost are taken as they are in that
iteration, so the bound is an estimate; but it is near the solution's cost after half of the iterations. Source: Boyd
and Vandenberghe, Convex Optimization (2004), 5.1.3.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index
from planner.backends.casadi_nlp.functions import KINDS
from planner.backends.casadi_nlp.layout import SHARED, StageLayout, Vector
from planner.backends.casadi_nlp.symbols import COST, FORMULAS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, RowIndex, row_index
from planner.native import OPTIMISER

ROWS_MAX = 64  # [-] of a block, and parameters that each stage has of its own, as in launch.c
SOLVED = 0
LATE = -2
OUT_OF_TIME = -3  # status of a call, as in launch.c

Options = dict[str, float]
Arguments = Mapping[str, Vector]  # x0, p, lbx, ubx, lbg, ubg


class _Block(ctypes.Structure):
    """`struct block` of launch.c."""

    _fields_ = (
        *((kind, ctypes.c_void_p) for kind in KINDS),
        ("jacobian", ctypes.c_void_p),
        ("hessian", ctypes.c_void_p),
        ("position", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("variables", "rows", "following", "into")),
        *((name, ctypes.c_int) for name in ("first", "last", "parameters", "each")),
    )


class _Problem(ctypes.Structure):
    """`struct problem` of launch.c."""

    _fields_ = (
        ("block", ctypes.POINTER(_Block)),
        ("own", ctypes.c_void_p),
        ("owned", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("blocks", "cost", "stages", "rows", "thrown")),
    )


class Outcome(NamedTuple):
    """What a call of the solver came to.

    Attributes:
        x: the variables (n,), or those at which it gave up; no numbers where not all numbers were finite, or it was
            ended.
        iterations: number of iterations.
        is_solved: whether they are an optimum.
        is_late: whether it was ended because it would come to no release that is soon enough.
        is_out_of_time: whether it was ended because it took too long.
    """

    x: Array
    iterations: int
    is_solved: bool
    is_late: bool = False
    is_out_of_time: bool = False


class Launch:
    """The problem of one layout, as launch.c takes it."""

    def __init__(self, index: RowIndex) -> None:
        self.index = index
        self._library = _library()
        self._kept: list[object] = []  # what the structures point to
        self._offsets, self.parameters = _parameter_offsets(index)
        blocks = (_Block * len(index.blocks))(*(self._block(name) for name in index.blocks))
        owned = self._integers(index.per_stage)
        own = self._integers([rows.start for rows in _own_rows(index)])
        names = list(index.blocks)
        stages = index.stages
        sizes = (len(names), names.index("cost"), stages.stages, index.size, stages.thrown)
        self._problem = _Problem(blocks, own, owned, *sizes)

    def solve(
        self,
        arguments: Mapping[str, Array],
        options: Mapping[str, float],
        latest: float = math.inf,
        seconds: float = math.inf,
    ) -> Outcome:
        """Returns what a call came to.

        Args:
            arguments: as casadi's solvers take them: x0, p, lbx, ubx, lbg, ubg.
            options: of fatrop.
            latest: time of the release, scaled, beyond which a solution is of no use.
            seconds: after which no iteration begins; it ends the call, and decides nothing else.

        Raises:
            ValueError: an argument has another size than the problem.
        """
        lower = np.concatenate([arguments["lbx"], arguments["lbg"]])
        upper = np.concatenate([arguments["ubx"], arguments["ubg"]])
        guess = np.ascontiguousarray(arguments["x0"], float)
        p = self._packed(arguments["p"])
        if {len(lower), len(upper)} != {self.index.variables + self.index.size} or len(guess) != self.index.variables:
            raise ValueError(f"{len(lower)} bounds and {len(guess)} variables do not fit the problem")
        names = (ctypes.c_char_p * len(options))(*(name.encode() for name in options))
        values = np.array(list(options.values()), float)
        x = np.zeros(self.index.variables)
        iterations = ctypes.c_int(0)
        status = self._library.solve_launch(
            ctypes.byref(self._problem),
            *(array.ctypes.data for array in (lower, upper, guess, p)),
            latest,
            len(options),
            names,
            values.ctypes.data,
            x.ctypes.data,
            ctypes.byref(iterations),
            seconds,
        )
        if status < SOLVED:  # it could not begin, some derivative was not finite, it did not return, or was ended
            x[:] = np.nan
        return Outcome(x, iterations.value, status == SOLVED, status == LATE, status == OUT_OF_TIME)

    def rows(self, x: Array, p: Array) -> Array:
        """Returns the rows (m,) at variables x (n,) and parameters p.

        Raises:
            ValueError: x has another size than the problem's variables.
        """
        x = np.ascontiguousarray(x, float)
        p = self._packed(p)
        rows = np.zeros(self.index.size)
        if len(x) != self.index.variables:
            raise ValueError(f"{len(x)} variables do not fit the problem")
        self._library.launch_rows(ctypes.byref(self._problem), x.ctypes.data, p.ctypes.data, rows.ctypes.data)
        return rows

    def _packed(self, p: Array) -> Array:
        """Returns every block's parameters one after the other, of p as in `transcription.ALL_SHARED`."""
        return np.asarray(p, float)[self.parameters]

    def _block(self, name: str) -> _Block:
        block = self.index.blocks[name]
        knots = self.index.knots[name]
        index = self.index
        following = index.following(name)
        each = FORMULAS[name].layout.size if name == "cost" else 0
        if max(block.n, each) > ROWS_MAX:
            raise ValueError(f"{name} has {block.n} rows, {each} parameters a stage; there is room for {ROWS_MAX}")
        positions = [index.rows[name, k] for k in knots] if name != "cost" else []
        return _Block(
            *(ctypes.cast(self._library[f"{block.name}_{kind}_lanes"], ctypes.c_void_p) for kind in KINDS),
            self._sparsity(f"{block.name}_slope"),
            self._sparsity(f"{block.name}_curve"),
            self._integers(np.concatenate([np.zeros(0), *positions])),
            block.variables,
            block.n,
            following.stop - following.start,
            following.start,
            knots.start,
            knots.stop,
            self._offsets[name],
            each,
        )

    def _sparsity(self, function: str) -> int:
        """Returns the address of the sparsity of a function's second result."""
        pattern = self._library[f"{function}_sparsity_out"]
        pattern.restype = ctypes.c_void_p
        return pattern(ctypes.c_longlong(1))

    def _integers(self, values: object) -> int:
        """Returns the address of an array of C's integers that lives as long as this object."""
        array = np.array(values, np.intc)
        self._kept.append(array)
        return array.ctypes.data


def _own_rows(index: RowIndex) -> list[range]:
    """Returns the rows of each stage, beside those of the next state."""
    rows = []
    begin = 0
    for k, own in enumerate(index.per_stage):
        begin += len(index.dynamics[k]) if k < index.stages.stages else 0
        rows.append(range(begin, begin + own))
        begin += own
    return rows


def _parameter_offsets(index: RowIndex) -> tuple[dict[str, int], Index]:
    """Returns where the parameters of each block begin, and the position of each of them in the problem's.

    Those of the cost are there for each stage: what all stages share, and the stage's own.
    """
    offsets: dict[str, int] = {}
    positions = [np.zeros(0, np.intp)]
    every = np.arange(ALL_SHARED.size)
    costs = ALL_SHARED.size + np.arange(COST.size * index.stages.stages).reshape(-1, COST.size)
    for name in index.blocks:
        offsets[name] = sum(map(len, positions))
        shared = [every[ALL_SHARED.slices[piece]] for piece in FORMULAS[name].parameters if piece in SHARED]
        positions += [each for own in costs for each in (*shared, own)] if name == "cost" else shared
    return offsets, np.concatenate(positions)


@cache
def launch_of(stages: StageLayout) -> Launch:
    """Returns the problem of a layout, built once per process."""
    return Launch(row_index(stages))


@cache
def _library() -> ctypes.CDLL:
    """Returns the optimiser's functions and what calls fatrop.

    Raises:
        OSError: the extension, or casadi's fatrop beside it, cannot be loaded.
    """
    library = ctypes.CDLL(str(OPTIMISER))
    pointer = ctypes.c_void_p
    numbers = [ctypes.c_double, ctypes.c_int]
    library.solve_launch.argtypes = [pointer] * 5 + numbers + [pointer] * 4 + numbers[:1]
    library.launch_rows.argtypes = [pointer] * 4
    library.launch_rows.restype = None
    return library
