"""casadi's own interface to fatrop: what `planner.backends.casadi_nlp.fatrop` is tested by.

It evaluates the whole problem, as `whole_problem` puts it together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.backends.casadi_nlp.fatrop import Arguments, Options, Outcome
from planner.backends.casadi_nlp.functions import evaluate
from planner.backends.casadi_nlp.layout import NU, NX, TIME, StageLayout, Vector
from planner.backends.casadi_nlp.transcription import Indices, RowIndex, row_index
from tests.planner.backends.whole_problem import Iterates, columns_at, states_at, whole_problem

PATTERNS_KEPT = 64  # solvers cached

# The blocks have all derivatives; casadi must not differentiate again.
QUIET = {"print_time": False, "error_on_fail": False, "calc_lam_p": False, "calc_lam_x": False}
Roles = dict[str, tuple[str, list[str]]]  # of functions, by the names that casadi gives to those it derives itself
COMMON_ROLES: Roles = {
    "nlp_f": ("f", ["f"]),
    "nlp_g": ("g", ["g"]),
    "nlp_jac_g": ("jac_g", ["g", "jac:g:x"]),
    "nlp_grad": ("all", ["f", "g", "grad:gamma:x", "grad:gamma:p"]),
}


@dataclass(frozen=True)
class CasadiLaunch:
    """The problem of one layout, as casadi calls fatrop for it; see `Launch`."""

    stages: StageLayout

    def solve(
        self, arguments: Arguments, options: Options, latest: float = math.inf, seconds: float = math.inf
    ) -> Outcome:
        """Returns what a call came to."""
        return solve_by_casadi(self.stages, arguments, options, latest)

    def rows(self, x: Vector, p: Vector) -> Vector:
        """Returns the rows (m,) at variables x (n,) and parameters p."""
        return evaluate(whole_problem(self.stages)["g"], x, p)[0].ravel()


def _stagewise(index: RowIndex) -> Indices:
    """Returns the positions of the variables in the order of casadi's interface: all states of a stage first."""
    stages = range(index.stages.stages + 1)
    ordered = np.concatenate([np.append(states_at(index, k), columns_at(index, k)[NX:]) for k in stages])
    return ordered[ordered >= 0]


def solve_by_casadi(stages: StageLayout, arguments: Arguments, options: Options, latest: float = math.inf) -> Outcome:
    """Returns what casadi's interface to fatrop comes to; see `Launch.solve`.

    casadi cannot end a call, but what comes after the iteration at which `Launch` ends it does not count. Without a
    weight the cost is left aside.
    """
    order = _stagewise(row_index(stages))
    ordered = {**arguments} | {name: arguments[name][order] for name in ("x0", "lbx", "ubx")}
    solver, functions, iterates = _fatrop(stages, _pattern(ordered), tuple(options.items()))
    iterates.seen.clear()
    found = np.array(solver(**ordered)["x"]).ravel()
    stats = solver.stats()
    begun = int(stats["iter_count"]) if stats["success"] else len(iterates.seen)  # casadi evaluates the solution, too
    for count, (x, weight, multipliers) in enumerate(iterates.seen[:begun], start=1):
        asks = latest < math.inf and weight > 0.0
        if asks and _least_release(functions, ordered, x, multipliers) > latest:
            return Outcome(np.full(len(order), np.nan), count, is_solved=False, is_late=True)
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
    index = row_index(stages)
    n = stages.stages
    functions = (
        whole_problem(stages) if index.core == index.variables else _reordered(whole_problem(stages), _stagewise(index))
    )
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
