"""Calls of the solver: fatrop with compiled rows, or through casadi.

casadi's interface evaluates the whole problem as sparse matrices and takes them apart again for every stage, which
takes as long as the rows themselves. The compiled launch (`c/launch.c`) hands fatrop each stage's matrices, several
stages at once. Both find the same numbers to the last bit; without a compiler, casadi's interface is used.

Two kinds of calls are ended before fatrop converges or gives up. Where no step is found, it leaves the cost aside and
looks for any variables that keep the rows (restoration): one such call in six comes to a solution, and they take half
of the time in cells where much is in the way. Other seeds do better in that time. And a call is ended whose release
would be too late. Of a convex problem, the Lagrangian at the multipliers of any iteration, less the most by which other
values of the variables and rows within their bounds could lower it, is no larger than the least cost (weak duality).
These problems are not convex, and the other terms of the cost are taken as they are in that iteration, so the bound is
an estimate; but it is near the solution's cost after half of the iterations. Source: Boyd and Vandenberghe, Convex
Optimization (2004), 5.1.3.
"""

from __future__ import annotations

import ctypes
import logging
import math
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from planner.arrays import Array, Index
from planner.backends.casadi_nlp import codegen
from planner.backends.casadi_nlp.functions import KINDS, evaluate, first_result
from planner.backends.casadi_nlp.layout import COST, NU, SHARED, TIME, StageLayout, Vector
from planner.backends.casadi_nlp.symbols import FORMULAS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, Indices, Iterates, RowIndex, transcription

ROWS_MAX = 64
OBJECTS_MAX = 2  # [-] of a block, and whose states there may be, as in launch.c
RESTORATIONS = "restorations"
ANY_NUMBER = 1 << 30  # iterations in which the cost may be left aside; without a limit
SOLVED = 0
LATE = -2  # status of a call, as in launch.c
PATTERNS_KEPT = 64  # solvers cached: a few for each kind of release

# The blocks have all derivatives; casadi must not differentiate again.
QUIET = {"print_time": False, "error_on_fail": False, "calc_lam_p": False, "calc_lam_x": False}
Options = dict[str, float]
Arguments = Mapping[str, Vector]  # x0, p, lbx, ubx, lbg, ubg
Roles = dict[str, tuple[str, list[str]]]  # of functions, by the names that casadi gives to those it derives itself
COMMON_ROLES: Roles = {
    "nlp_f": ("f", ["f"]),
    "nlp_g": ("g", ["g"]),
    "nlp_jac_g": ("jac_g", ["g", "jac:g:x"]),
    "nlp_grad": ("all", ["f", "g", "grad:gamma:x", "grad:gamma:p"]),
}


class _Block(ctypes.Structure):
    """`struct block` of launch.c."""

    _fields_ = (
        *((kind, ctypes.c_void_p) for kind in KINDS),
        ("jacobian", ctypes.c_void_p),
        ("hessian", ctypes.c_void_p),
        ("position", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("variables", "rows", "object", "following", "into")),
        *((name, ctypes.c_int) for name in ("first", "last", "parameters", "each")),
    )


class _Problem(ctypes.Structure):
    """`struct problem` of launch.c."""

    _fields_ = (
        ("block", ctypes.POINTER(_Block)),
        ("own", ctypes.c_void_p),
        ("owned", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("blocks", "cost", "stages", "rows")),
        ("thrown", ctypes.c_int * OBJECTS_MAX),
    )


class Outcome(NamedTuple):
    """What a call of the solver came to.

    Attributes:
        x: the variables (n,), or those at which it gave up; no numbers where not all numbers were finite, or it was
            ended.
        iterations: number of iterations.
        is_solved: whether they are an optimum.
        is_late: whether it was ended because it would come to no release that is soon enough.
    """

    x: Array
    iterations: int
    is_solved: bool
    is_late: bool = False


class CompiledLaunch:
    """The problem of one layout, as the compiled launch takes it."""

    def __init__(self, index: RowIndex, launch: ctypes.CDLL, functions: ctypes.CDLL) -> None:
        self.index = index
        self._launch = launch
        self._functions = functions
        self._kept: list[object] = []  # what the structures point to
        self._offsets, self.parameters = _parameter_offsets(index)
        blocks = (_Block * len(index.blocks))(*(self._block(name) for name in index.blocks))
        owned = self._integers(index.per_stage)
        own = self._integers([rows.start for rows in _own_rows(index)])
        names = list(index.blocks)
        stages = index.stages
        none = (stages.stages + 1,) * (OBJECTS_MAX - len(stages.objects))
        thrown = (ctypes.c_int * OBJECTS_MAX)(*stages.objects, *none)
        self._problem = _Problem(blocks, own, owned, len(names), names.index("cost"), stages.stages, index.size, thrown)

    def solve(self, arguments: Mapping[str, Array], options: Mapping[str, float], latest: float = math.inf) -> Outcome:
        """Returns what a call came to.

        Args:
            arguments: as casadi's solvers take them: x0, p, lbx, ubx, lbg, ubg.
            options: of fatrop, and `RESTORATIONS`.
            latest: time of the release, scaled, beyond which a solution is of no use.

        Raises:
            ValueError: an argument has another size than the problem.
        """
        lower = np.concatenate([arguments["lbx"], arguments["lbg"]])
        upper = np.concatenate([arguments["ubx"], arguments["ubg"]])
        guess = np.ascontiguousarray(arguments["x0"], float)
        p = self._packed(arguments["p"])
        if {len(lower), len(upper)} != {self.index.variables + self.index.size} or len(guess) != self.index.variables:
            raise ValueError(f"{len(lower)} bounds and {len(guess)} variables do not fit the problem")
        of_fatrop = _of_fatrop(options)
        names = (ctypes.c_char_p * len(of_fatrop))(*(name.encode() for name in of_fatrop))
        values = np.array(list(of_fatrop.values()), float)
        x = np.zeros(self.index.variables)
        iterations = ctypes.c_int(0)
        status = self._launch.solve_launch(
            ctypes.byref(self._problem),
            *(array.ctypes.data for array in (lower, upper, guess, p)),
            latest,
            int(options.get(RESTORATIONS, ANY_NUMBER)),
            len(of_fatrop),
            names,
            values.ctypes.data,
            x.ctypes.data,
            ctypes.byref(iterations),
        )
        if status < SOLVED:  # it could not begin, some derivative was not finite, it did not return, or was ended
            x[:] = np.nan
        return Outcome(x, iterations.value, status == SOLVED, status == LATE)

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
        self._launch.launch_rows(ctypes.byref(self._problem), x.ctypes.data, p.ctypes.data, rows.ctypes.data)
        return rows

    def _packed(self, p: Array) -> Array:
        """Returns every block's parameters one after the other, of p as in `transcription.ALL_SHARED`."""
        return np.asarray(p, float)[self.parameters]

    def _block(self, name: str) -> _Block:
        block = self.index.blocks[name]
        knots = self.index.knots[name]
        index = self.index
        following = index.following(name)
        if block.n > ROWS_MAX:
            raise ValueError(f"{name} has {block.n} rows; there is room for {ROWS_MAX}")
        positions = [index.rows[name, k] for k in knots] if name != "cost" else []
        return _Block(
            *(ctypes.cast(self._functions[f"{block.name}_{kind}_lanes"], ctypes.c_void_p) for kind in KINDS),
            self._sparsity(f"{block.name}_slope"),
            self._sparsity(f"{block.name}_curve"),
            self._integers(np.concatenate([np.zeros(0), *positions])),
            block.variables,
            block.n,
            0,
            following.stop - following.start,
            following.start,
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


def _of_fatrop(options: Mapping[str, float]) -> Options:
    """Returns those of a call's options that fatrop knows."""
    return {name: value for name, value in options.items() if name != RESTORATIONS}


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
        launch = ctypes.CDLL(str(path))
        functions = ctypes.CDLL(str(codegen.library()))
    except OSError as error:
        logging.getLogger(__name__).warning("%s is not used, casadi's interface is: %s", path, error)
        return None
    pointer = ctypes.c_void_p
    numbers = [ctypes.c_double, ctypes.c_int, ctypes.c_int]
    launch.solve_launch.argtypes = [pointer] * 5 + numbers + [pointer] * 4
    launch.launch_rows.argtypes = [pointer] * 4
    launch.launch_rows.restype = None
    launch.linear_algebra_agrees()
    return launch, functions


def solve_by_fatrop(stages: StageLayout, arguments: Arguments, options: Options, latest: float = math.inf) -> Outcome:
    """Returns what casadi's interface to fatrop comes to; see `CompiledLaunch.solve`.

    casadi cannot end a call, but what comes after the iteration at which the compiled launch ends it does not count.
    Without a weight the cost is left aside.
    """
    order = transcription(stages).row_index.stagewise
    ordered = {**arguments} | {name: arguments[name][order] for name in ("x0", "lbx", "ubx")}
    solver, functions, iterates = _fatrop(stages, _pattern(ordered), tuple(_of_fatrop(options).items()))
    iterates.seen.clear()
    found, stats = first_result(solver, ordered)
    restorations = options.get(RESTORATIONS, ANY_NUMBER)
    begun = int(stats["iter_count"]) if stats["success"] else len(iterates.seen)  # casadi evaluates the solution, too
    for count, (x, weight, multipliers) in enumerate(iterates.seen[:begun], start=1):
        restorations -= weight == 0.0
        is_restoring = restorations < 0
        asks = latest < math.inf and weight > 0.0
        if is_restoring or (asks and _least_release(functions, ordered, x, multipliers) > latest):
            return Outcome(np.full(len(order), np.nan), count, is_solved=False, is_late=not is_restoring)
    x = np.empty(len(order))
    x[order] = found
    return Outcome(x, int(stats["iter_count"]), bool(stats["success"]))


def _least_release(functions: Mapping[str, Any], arguments: Arguments, x: Vector, multipliers: Vector) -> float:
    """Returns about the least time of the release, scaled, that a solve can come to, by an iteration's multipliers.

    It is the bound on the cost less the other terms of the cost, as of that iteration. A bound above the cost of that
    iteration says nothing, nor do multipliers of zero, with which fatrop begins anew where a step fails.

    Args:
        functions: of the problem.
        arguments: of the call.
        x: the iteration's variables, stage by stage (n,).
        multipliers: of the rows (m,).
    """
    p = arguments["p"]
    slope = evaluate(functions["hess_l"], x, p, np.ones(1), multipliers)[0].ravel()
    g = evaluate(functions["g"], x, p)[0].ravel()
    less = _least_within(-multipliers, g, arguments["lbg"], arguments["ubg"])
    less += _least_within(slope, x, arguments["lbx"], arguments["ubx"])
    return less - float(x[TIME]) if less < 0.0 else -math.inf


def _least_within(slope: Vector, values: Vector, lower: Vector, upper: Vector) -> float:
    """Returns the least change of what is linear, with `slope` at `values`, within bounds; nothing where one lacks.

    A variable without bounds has no slope at a solution, and little before.
    """
    end = np.where(slope > 0.0, lower, upper)
    bounded = np.isfinite(end)
    return float(slope[bounded] @ (end - values)[bounded])


def _pattern(arguments: Arguments) -> bytes:
    """Returns which variables and rows are fixed (2), bounded (1) or free (0)."""
    lower = np.concatenate([arguments["lbx"], arguments["lbg"]])
    upper = np.concatenate([arguments["ubx"], arguments["ubg"]])
    bounded = np.isfinite(lower) | np.isfinite(upper)
    return (bounded.astype(np.int8) + (lower == upper)).astype(np.int8).tobytes()


@lru_cache(maxsize=PATTERNS_KEPT)
def _fatrop(
    stages: StageLayout, pattern: bytes, options: tuple[tuple[str, float], ...]
) -> tuple[Any, Mapping[str, Any], Iterates]:
    """Returns the solver for one pattern of fixed, bounded and free variables and rows, with fatrop's options.

    With it come the problem's functions of the variables stage by stage, and the iterations of the last call.

    casadi 3.8.2 makes fatrop anew where the pattern differs from the call before, and then loses its options: each
    pattern has a solver of its own, built in 7 ms.
    """
    made = transcription(stages)
    index = made.row_index
    n = stages.stages
    functions = made.functions if index.core == index.variables else _reordered(made.functions, index.stagewise)
    roles = {"nlp_grad_f": ("grad_f", ["grad:f:x"]), "nlp_hess_l": ("hess_l", ["grad:gamma:x", "hess:gamma:x:x"])}
    states = [index.states(k) for k in range(n + 1)]
    structure = {"structure_detection": "manual", "N": n, "nx": states, "nu": [NU] * n + [0]}
    settings = {**structure, "ng": index.per_stage, "fatrop": dict(options)}
    iterates = Iterates(index.variables, index.size)
    x, p, of_cost, of_rows = inputs = functions["hess_l"].mx_in()
    noted = ca.Function("noted", inputs, functions["hess_l"].call([iterates(x, of_cost, of_rows), p, of_cost, of_rows]))
    return _nlpsol("fatrop", {**functions, "hess_l": noted}, roles, settings), functions, iterates


def _reordered(functions: Mapping[str, Any], order: Indices) -> dict[str, Any]:
    """Returns the problem's functions of variables in another order."""
    back = np.argsort(order).tolist()
    to = order.tolist()
    sorted_ones: dict[str, Any] = {}
    for name, function in functions.items():
        x, *more = inputs = function.mx_in()
        results = list(function.call([x[back], *more]))
        if name == "grad_f":
            results = [results[0][to]]
        elif name == "jac_g":
            results = [results[0], results[1][:, to]]
        elif name == "hess_l":
            results = [results[0][to], results[1][to, to]]
        sorted_ones[name] = ca.Function(name, inputs, results)
    return sorted_ones


def _nlpsol(plugin: str, functions: Mapping[str, Any], roles: Roles, settings: Mapping[str, Any]) -> Any:
    x, p = functions["g"].mx_in()
    problem = {"x": x, "p": p, "f": functions["f"](x, p), "g": functions["g"](x, p)}
    derived = _in_roles({**functions, "all": _summary(functions)}, {**COMMON_ROLES, **roles})
    return ca.nlpsol("launch", plugin, problem, {**QUIET, "cache": derived, **settings})


def _in_roles(functions: Mapping[str, Any], roles: Roles) -> dict[str, Any]:
    """Returns the functions under the names that casadi gives to those it derives itself."""
    named = {}
    for role, (name, outputs) in roles.items():
        inputs = functions[name].mx_in()
        scheme = ["x", "p", "lam:f", "lam:g"][: len(inputs)]
        taken, given = ([name.replace(":", "_") for name in names] for names in (scheme, outputs))
        named[role] = ca.Function(role, inputs, functions[name].call(inputs), taken, given)
    return named


def _summary(functions: Mapping[str, Any]) -> Any:
    """Returns what casadi evaluates at the solution: values, and the Lagrangian's gradient, which p has no part in."""
    inputs = x, p, *_ = functions["hess_l"].mx_in()
    slope = functions["hess_l"](*inputs)[0]
    return ca.Function("all", inputs, [functions["f"](x, p), functions["g"](x, p), slope, ca.MX.zeros(p.shape)])
