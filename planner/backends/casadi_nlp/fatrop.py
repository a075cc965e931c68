"""A launch solved by fatrop without casadi between them: compiled rows and derivatives, several stages at once.

casadi's interface evaluates the whole problem as sparse matrices and takes them apart again for every stage, which
takes as long as the rows themselves. The compiled launch (`c/launch.c`) hands fatrop each stage's matrices. Both find
the same numbers to the last bit; without a compiler, casadi's interface is used.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Mapping
from functools import cache

import numpy as np

from planner.arrays import Array, Index
from planner.backends.casadi_nlp import codegen
from planner.backends.casadi_nlp.functions import KINDS
from planner.backends.casadi_nlp.layout import COST, NX, SHARED
from planner.backends.casadi_nlp.symbols import FORMULAS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, RowIndex, StageLayout, transcription

ROWS_MAX = 64  # [-] of a block, as in launch.c
SOLVED = 0  # fatrop's status


class _Block(ctypes.Structure):
    """`struct block` of launch.c."""

    _fields_ = (
        *((kind, ctypes.c_void_p) for kind in KINDS),
        ("jacobian", ctypes.c_void_p),
        ("hessian", ctypes.c_void_p),
        ("position", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("rows", "following", "first", "last", "parameters", "each")),
    )


class _Problem(ctypes.Structure):
    """`struct problem` of launch.c."""

    _fields_ = (
        ("block", ctypes.POINTER(_Block)),
        ("own", ctypes.c_void_p),
        ("owned", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("blocks", "cost", "stages", "rows")),
    )


class CompiledLaunch:
    """The problem of one layout, as the compiled launch takes it."""

    def __init__(self, index: RowIndex, launch: ctypes.CDLL, functions: ctypes.CDLL) -> None:
        self.index, self._launch, self._functions = index, launch, functions
        self._kept: list[object] = []  # what the structures point to
        self._offsets, self.parameters = _parameter_offsets(index)
        blocks = (_Block * len(index.blocks))(*(self._block(name) for name in index.blocks))
        owned = self._integers(index.per_stage)
        own = self._integers([rows.start for rows in _own_rows(index)])
        names = list(index.blocks)
        self._problem = _Problem(blocks, own, owned, len(names), names.index("cost"), index.stages.stages, index.size)

    def solve(self, arguments: Mapping[str, Array], options: Mapping[str, float]) -> tuple[Array, int, bool]:
        """Returns the variables (n,), the number of iterations, and whether the problem is solved.

        The variables are those at which fatrop gave up, where it did; no numbers where not all numbers were finite, or
        fatrop did not return.

        Args:
            arguments: as casadi's solvers take them: x0, p, lbx, ubx, lbg, ubg.
            options: of fatrop.

        Raises:
            ValueError: an argument has another size than the problem.
        """
        lower = np.concatenate([arguments["lbx"], arguments["lbg"]])
        upper = np.concatenate([arguments["ubx"], arguments["ubg"]])
        guess, p = np.ascontiguousarray(arguments["x0"], float), self._packed(arguments["p"])
        if {len(lower), len(upper)} != {self.index.variables + self.index.size} or len(guess) != self.index.variables:
            raise ValueError(f"{len(lower)} bounds and {len(guess)} variables do not fit the problem")
        names = (ctypes.c_char_p * len(options))(*(name.encode() for name in options))
        values = np.array(list(options.values()), float)
        x, iterations = np.zeros(self.index.variables), ctypes.c_int(0)
        status = self._launch.solve_launch(
            ctypes.byref(self._problem),
            *(array.ctypes.data for array in (lower, upper, guess, p)),
            len(options),
            names,
            values.ctypes.data,
            x.ctypes.data,
            ctypes.byref(iterations),
        )
        if status < SOLVED:  # it could not begin, some derivative was not finite, or it did not return
            x[:] = np.nan
        return x, iterations.value, status == SOLVED

    def rows(self, x: Array, p: Array) -> Array:
        """Returns the rows (m,) at variables x (n,) and parameters p.

        Raises:
            ValueError: x has another size than the problem's variables.
        """
        x, p, rows = np.ascontiguousarray(x, float), self._packed(p), np.zeros(self.index.size)
        if len(x) != self.index.variables:
            raise ValueError(f"{len(x)} variables do not fit the problem")
        self._launch.launch_rows(ctypes.byref(self._problem), x.ctypes.data, p.ctypes.data, rows.ctypes.data)
        return rows

    def _packed(self, p: Array) -> Array:
        """Returns every block's parameters one after the other, of p as in `transcription.ALL_SHARED`."""
        return np.asarray(p, float)[self.parameters]

    def _block(self, name: str) -> _Block:
        index, block, knots = self.index, self.index.blocks[name], self.index.knots[name]
        if block.n > ROWS_MAX:
            raise ValueError(f"{name} has {block.n} rows; there is room for {ROWS_MAX}")
        positions = [index.rows[name, k] for k in knots] if name != "cost" else []
        return _Block(
            *(ctypes.cast(self._functions[f"{block.name}_{kind}_lanes"], ctypes.c_void_p) for kind in KINDS),
            self._sparsity(f"{block.name}_slope"),
            self._sparsity(f"{block.name}_curve"),
            self._integers(np.concatenate([np.zeros(0), *positions])),
            block.n,
            NX if name == "motion" else 0,
            knots.start,
            knots.stop,
            self._offsets[name],
            COST.size if name == "cost" else 0,
        )

    def _sparsity(self, function: str) -> int:
        """Returns the address of the sparsity of a function's second result."""
        pattern = self._functions[f"{function}_sparsity_out"]
        pattern.restype = ctypes.c_void_p
        return pattern(ctypes.c_longlong(1))

    def _integers(self, values: object) -> int:
        """Returns the address of an array of C's integers that lives as long as this object."""
        array = np.array(values, np.intc)
        self._kept.append(array)
        return array.ctypes.data


def _own_rows(index: RowIndex) -> list[range]:
    """Returns the rows of each stage, beside those of the next state."""
    rows, begin = [], 0
    for k, own in enumerate(index.per_stage):
        begin += NX if k < index.stages.stages else 0
        rows.append(range(begin, begin + own))
        begin += own
    return rows


def _parameter_offsets(index: RowIndex) -> tuple[dict[str, int], Index]:
    """Returns where the parameters of each block begin, and the position of each of them in the problem's."""
    offsets: dict[str, int] = {}
    positions = [np.zeros(0, np.intp)]
    for name in index.blocks:
        offsets[name] = sum(map(len, positions))
        if name == "cost":
            positions.append(ALL_SHARED.size + np.arange(COST.size * index.stages.stages))
        else:
            every = np.arange(ALL_SHARED.size)
            positions += [every[ALL_SHARED.slices[piece]] for piece in SHARED if piece in FORMULAS[name].parameters]
    return offsets, np.concatenate(positions)


@cache
def compiled_launch(stages: StageLayout) -> CompiledLaunch | None:
    """Returns the compiled problem of a layout, None where casadi's interface is used."""
    libraries = _libraries()
    return None if libraries is None else CompiledLaunch(transcription(stages).row_index, *libraries)


@cache
def _libraries() -> tuple[ctypes.CDLL, ctypes.CDLL] | None:
    """Returns the libraries of the launch and of the blocks' functions, None unless both are compiled."""
    path = codegen.launch_library()
    if path is None or not path.exists() or not codegen.loaded_blocks().compiled:
        return None
    try:
        launch, functions = ctypes.CDLL(str(path)), ctypes.CDLL(str(codegen.library()))
    except OSError as error:
        logging.getLogger(__name__).warning("%s is not used, casadi's interface is: %s", path, error)
        return None
    pointer = ctypes.c_void_p
    launch.solve_launch.argtypes = [pointer] * 5 + [ctypes.c_int] + [pointer] * 4
    launch.launch_rows.argtypes, launch.launch_rows.restype = [pointer] * 4, None
    launch.linear_algebra_agrees()
    return launch, functions
