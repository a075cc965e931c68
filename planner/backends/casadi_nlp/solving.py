"""Running the solvers on as few rows as will do.

Most rows of most requests never come near their bound: a solve without them takes a third of the time and fails less
often. What is left out is looked at afterwards, and held in a further solve, from there on, where it is broken.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import buffered, codegen, solvers
from planner.backends.casadi_nlp.assembly import assemble
from planner.backends.casadi_nlp.blocks import Block, interpreted
from planner.backends.casadi_nlp.layout import NX, NZ, Q
from planner.backends.casadi_nlp.table import Shape, Table
from planner.errors import SolverFailed

Vector = NDArray[np.float64]
Call = dict[str, Any]

# source of the options: measured on random problems; the LU tolerance keeps fatrop 1.1.8 from an endless factorisation
FATROP = {"tolerance": 1e-4, "mu_init": 1e-3, "max_iter": 70, "linsol_lu_fact_tol": 1e-2}
POLISH = {**FATROP, "mu_init": 1e-4, "max_iter": 40}  # begins near its optimum
# What is below it is taken for nothing, and in the short stages of a window a jerk moves the landing by 2 to 3 mm. Not
# for every problem: one `point` of sixty never ended with 1e-4.
SHORT_STAGES = {"linsol_lu_fact_tol": 1e-3}
IPOPT = {"tol": 1e-5, "mu_init": 1e-3, "max_iter": 80}
SECOND_TRY_S = 0.15  # [s] of time left that IPOPT is worth
PATTERNS_MAX = 64  # solvers kept: a few for each kind of release
BROKEN = 1e-3  # [-, m, rad] beyond its bound, what was left out is held; a solver's own tolerance is a tenth of it
POSITIONS = "positions"  # the group of the joints' position limits, which are bounds of variables and rows of "motion"


@dataclass(frozen=True)
class Machine:
    """An assembled problem."""

    shape: Shape
    table: Table
    blocks: dict[str, Block]
    functions: dict[str, Any]


@cache
def machine(shape: Shape) -> Machine:
    """Returns the problem of a shape, built once a process; with compiled functions where there are any."""
    blocks = codegen.compiled() or interpreted()
    functions, table = assemble(shape, blocks)
    return Machine(shape, table, blocks, functions)


@lru_cache(maxsize=PATTERNS_MAX)
def _fatrop(shape: Shape, pattern: bytes, polish: bool) -> Any:
    """Returns the solver for one pattern of equalities, inequalities and free rows.

    casadi 3.8.2 makes fatrop anew where the pattern differs from the call before, and then forgets its options: each
    pattern gets a solver of its own, which takes a few milliseconds.
    """
    made = machine(shape)
    options = {**(POLISH if polish else FATROP), **(SHORT_STAGES if shape.window > 1 else {})}
    return solvers.fatrop(made.functions, made.table, options)


@cache
def _ipopt(shape: Shape) -> Any:
    return solvers.ipopt(machine(shape).functions, IPOPT)


@cache
def _places(part: Shape, whole: Shape) -> NDArray[np.intp]:
    return machine(part).table.within(machine(whole).table)


@cache
def _rows_by_group(whole: Shape) -> dict[str, NDArray[np.intp]]:
    table = machine(whole).table
    rows = {group: np.concatenate([table.rows_of(group), table.rows_of(f"{group}_middle")]) for group in whole.groups}
    positions = [table.rows["motion", k][NX + 6 :] for k in table.shape.knots("motion")]
    return {**rows, POSITIONS: np.concatenate(positions)}


class Solving:
    """One request's calls of the solvers: what was spent, and which groups of rows turned out to matter.

    Attributes:
        whole: the shape with every group of rows; a call is made for it.
        deadline_s: on `time.perf_counter`.
        groups: held so far.
        stubborn: whether the slow second solver is asked where the first gives up.
        iterations: spent so far.
        status: how the last solver ended, in words.
    """

    def __init__(self, whole: Shape, deadline_s: float, groups: frozenset[str], stubborn: bool) -> None:
        self.whole, self.deadline_s, self.groups, self.stubborn = whole, deadline_s, groups, stubborn
        self.iterations = 0
        self.status = ""

    @property
    def table(self) -> Table:
        """Of the whole problem."""
        return machine(self.whole).table

    @property
    def left_s(self) -> float:
        """Time left [s]."""
        return self.deadline_s - time.perf_counter()

    def solve(self, call: Call) -> Vector:
        """Returns the variables (N + 1, NZ) of the solution; where fatrop gives up, IPOPT's if that is wanted.

        Args:
            call: what a solver of the whole problem is called with.

        Raises:
            SolverFailed: they gave up, or time ran out.
        """
        z = self.lazily(call, polish=False)
        if z is None and self.stubborn and self.left_s > SECOND_TRY_S:
            z = self._call("ipopt", _ipopt(self.whole), call)
        if z is None:
            raise SolverFailed(self.status or "out of time", self.iterations)
        return z

    def lazily(self, call: Call, polish: bool) -> Vector | None:
        """Returns fatrop's solution, None where it gives up; groups are added as they turn out to be broken."""
        while self.left_s > 0.0:
            z = self._by_fatrop(call, polish)
            if z is None:
                return None
            broken = self._broken(call, z) - self.groups
            if not broken:
                return z
            self.groups |= broken
            call = {**call, "x0": z.ravel()[: self.table.variables]}
        return None

    def _by_fatrop(self, call: Call, polish: bool) -> Vector | None:
        part = _part(self.whole, self.groups)
        reduced = dict(call)
        if POSITIONS not in self.groups:
            _free_positions(self.whole, reduced)
        places = _places(part, self.whole)
        reduced["lbg"], reduced["ubg"] = reduced["lbg"][places], reduced["ubg"][places]
        return self._call("fatrop", _fatrop(part, _pattern(reduced), polish), reduced)

    def _call(self, name: str, solver: Any, call: Call) -> Vector | None:
        x, stats = buffered.first_result(solver, call)
        self.iterations += int(stats["iter_count"])
        ok = bool(stats["success"]) and bool(np.isfinite(x).all())
        self.status = f"{name}: {'solved' if ok else 'gave up'} in {stats['iter_count']} iterations"
        return np.append(x, np.zeros(NZ - NX)).reshape(-1, NZ) if ok else None

    def _broken(self, call: Call, z: Vector) -> set[str]:
        """Returns the groups of which some row is beyond its bound."""
        x = z.ravel()[: self.table.variables]
        g = buffered.evaluate(machine(self.whole).functions["g"], x, call["p"])[0].ravel()
        beyond = np.maximum(call["lbg"] - g, g - call["ubg"]) > BROKEN
        broken = {group for group, rows in _rows_by_group(self.whole).items() if beyond[rows].any()}
        outside = np.append(np.maximum(call["lbx"] - x, x - call["ubx"]), np.zeros(NZ - NX)).reshape(-1, NZ)[:, Q]
        return broken | ({POSITIONS} if (outside > BROKEN).any() else set())


def _part(whole: Shape, groups: frozenset[str]) -> Shape:
    return Shape(whole.launch, whole.brake, whole.window, tuple(g for g in whole.groups if g in groups))


def _free_positions(whole: Shape, call: Call) -> None:
    """Frees joint positions that are not fixed."""
    for name, side in (("lbx", -np.inf), ("ubx", np.inf)):
        call[name] = np.where(_position_entries(whole) & (call["lbx"] != call["ubx"]), side, call[name])
    for name, side in (("lbg", -np.inf), ("ubg", np.inf)):
        call[name] = call[name].copy()
        call[name][_rows_by_group(whole)[POSITIONS]] = side


@cache
def _position_entries(whole: Shape) -> NDArray[np.bool_]:
    entries = np.zeros((whole.stages + 1, NZ), dtype=bool)
    entries[:, Q] = True
    return entries.ravel()[: machine(whole).table.variables]


def _pattern(call: Call) -> bytes:
    """Returns which variables and rows are fixed (2), bounded (1) or free (0)."""
    lower = np.concatenate([call["lbx"], call["lbg"]])
    upper = np.concatenate([call["ubx"], call["ubg"]])
    bounded = np.isfinite(lower) | np.isfinite(upper)
    return (bounded.astype(np.int8) + (lower == upper)).astype(np.int8).tobytes()
