"""Solver: fatrop on as few rows as are needed.

Most rows of most problems never come near their bounds, and a solve without them takes half the time per iteration and
fails less often. What is left out is evaluated afterwards and, where violated, included in a further solve from there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.backends.casadi_nlp.fatrop import compiled_launch
from planner.backends.casadi_nlp.functions import evaluate, first_result
from planner.backends.casadi_nlp.instance import Arguments, Instance
from planner.backends.casadi_nlp.layout import NU, NX, NZ, QD, TIME, Q, Vector
from planner.backends.casadi_nlp.transcription import ALL_SHARED, Indices, StageLayout, transcription
from planner.errors import SolverFailed

# What falls below the LU tolerance is dropped where equalities are eliminated. With a smaller one fatrop 1.1.8 raises
# its regularisation without end on one `point` of sixty. In a stage of 5 ms, however, a jerk moves the landing by 2 to
# 3 mm, which 1e-2 drops: 44 of 52 problems with a window did not converge.
FATROP = {"print_level": 0, "tolerance": 1e-4, "mu_init": 1e-3, "max_iter": 70, "linsol_lu_fact_tol": 1e-2}
FATROP_FIXED_TIMES = {"mu_init": 1e-4, "max_iter": 40}  # starts close to its optimum
FATROP_SHORT_STAGES = {"linsol_lu_fact_tol": 1e-3, "max_iter": 120}
FATROP_AFRESH = {"mu_init": 1.0}  # a larger barrier leads elsewhere
IPOPT = {"tol": 1e-5, "mu_init": 1e-3, "max_iter": 80}
PATTERNS_KEPT = 64  # solvers cached: a few for each kind of release
# [-, m, rad] A row left out is included when it is this far beyond its bound, and what fatrop gives up is a solution if
# none is: ten times the tolerance.
VIOLATED = 1e-3
PATHS_MAX = 2  # [-] further solutions for a path of the object that has moved with the one before
POSITIONS = "positions"  # group of the joints' position limits: bounds of variables, and rows of block "motion"

# The blocks have all derivatives; casadi must not differentiate again.
QUIET = {"print_time": False, "error_on_fail": False, "calc_lam_p": False, "calc_lam_x": False}
Options = dict[str, float]
Roles = dict[str, tuple[str, list[str]]]  # of functions, by the names that casadi gives to those it derives itself
COMMON_ROLES: Roles = {
    "nlp_f": ("f", ["f"]),
    "nlp_g": ("g", ["g"]),
    "nlp_jac_g": ("jac_g", ["g", "jac:g:x"]),
    "nlp_grad": ("all", ["f", "g", "grad:gamma:x", "grad:gamma:p"]),
}


class Solver:
    """The solver calls of one `solve`, with their common budget.

    Attributes:
        iteration_budget: no further call begins when the iterations of all calls reach it.
        deadline_s: on `time.perf_counter`; no further call begins after it. None for no deadline.
        groups: rows included so far: of `LAZY_GROUPS`, or `POSITIONS`.
        with_ipopt: whether IPOPT is called where fatrop gives up.
        latest_s: no further call begins from a solution that releases later than this; infinite for no such time.
        iterations: spent so far.
        status: outcome of the last call.
        is_late: whether a solution released too late: with more rows, or a window, it would release later still.
        has_converged: whether the last call ended at an optimum.
    """

    def __init__(
        self,
        iteration_budget: int,
        deadline_s: float | None,
        groups: frozenset[str],
        with_ipopt: bool,
        latest_s: float = math.inf,
    ) -> None:
        self.iteration_budget, self.deadline_s, self.groups = iteration_budget, deadline_s, groups
        self.with_ipopt, self.latest_s, self.is_late = with_ipopt, latest_s, False
        self.iterations = 0
        self.status = ""
        self.has_converged = False

    def solve(self, instance: Instance) -> Vector:
        """Returns the variables (N + 1, NZ) of the solution, in SI units.

        Raises:
            SolverFailed: the solver gave up, or the budget is spent.
        """
        z = self.try_solve(instance)
        if z is None and self.with_ipopt and not self.is_late and not self._is_spent():
            scaled = self._call_ipopt(instance)
            z = None if scaled is None else scaled * instance.scales
        if z is None:
            raise SolverFailed(self.status, self.iterations)
        return z

    def try_correction(self, instance: Instance) -> Vector | None:
        """Returns as `try_solve`, without a part in the budget: who corrects bounds the number of corrections."""
        spent = self.iterations
        z = self.try_solve(instance)
        self.iterations = spent
        return z

    def try_solve(self, instance: Instance) -> Vector | None:
        """Returns the solution, in SI units, None where the solver gives up.

        Groups of rows are included as they are violated; the object's path follows each solution.
        """
        first = instance.arguments
        arguments, kept, moved = first, None, 0
        while not self._is_spent():
            z = self._without_other_groups(instance, arguments)
            if z is None and arguments["x0"] is not first["x0"] and _may_begin_again(instance):
                arguments = {**arguments, "x0": first["x0"]}  # what was solved before was too far off
                continue
            if z is None:
                break
            release_s = float(-z[0, TIME] * instance.scales[TIME])
            if release_s > self.latest_s:
                self.is_late = self.has_converged  # else more iterations might lead to a sooner one
                self.status = f"releases after {release_s:.3f} s, no sooner than another"
                return None
            arguments = {**arguments, "x0": z.ravel()[: len(first["x0"])], "p": _with_path_of(instance, z)}
            violated = _violated_groups(instance, z, arguments["p"])
            if violated <= self.groups:
                kept = z * instance.scales  # clear of the path of the solution before, at least
                if "passing" not in violated or moved == PATHS_MAX:
                    break
                moved += 1
            self.groups |= violated
        return kept

    def _is_spent(self) -> bool:
        if self.iterations >= self.iteration_budget:
            self.status = f"out of iterations: {self.iterations} of {self.iteration_budget}"
        elif self.deadline_s is not None and time.perf_counter() >= self.deadline_s:
            self.status = "out of time"
        else:
            return False
        return True

    def _without_other_groups(self, instance: Instance, arguments: Arguments) -> Vector | None:
        whole = instance.stages
        part = whole.with_groups(self.groups)
        reduced = dict(arguments)
        if POSITIONS not in self.groups:
            _free_positions(whole, reduced)
        kept = _rows_kept(part, whole)
        reduced["lbg"], reduced["ubg"] = reduced["lbg"][kept], reduced["ubg"][kept]
        options = _fatrop_options(part, instance.fixed_times is not None)
        x, iterations = self._call_fatrop(part, reduced, options)
        ran_out = x is None and iterations >= options["max_iter"]
        if ran_out and _may_start_afresh(instance) and not self._is_spent():
            x, _ = self._call_fatrop(part, reduced, options | FATROP_AFRESH)
        return x

    def _call_fatrop(self, part: StageLayout, arguments: Arguments, options: Options) -> tuple[Vector | None, int]:
        """Returns the solution, None where there is none, and the number of iterations.

        What breaks no row where fatrop gives up is a solution, too, if not an optimal one: it often turns on the spot,
        along what hardly changes the cost.
        """
        launch = compiled_launch(part)
        if launch is None:
            x, stats = first_result(_fatrop(part, _pattern(arguments), tuple(options.items())), arguments)
            iterations, is_solved = int(stats["iter_count"]), bool(stats["success"])
        else:
            x, iterations, is_solved = launch.solve(arguments, options)
        self.has_converged = is_solved
        return self._result("fatrop", x, iterations, is_solved or _breaks_no_row(part, x, arguments)), iterations

    def _call_ipopt(self, instance: Instance) -> Vector | None:
        x, stats = first_result(_ipopt(instance.stages), instance.arguments)
        return self._result("ipopt", x, int(stats["iter_count"]), bool(stats["success"]))

    def _result(self, name: str, x: Vector, iterations: int, is_solved: bool) -> Vector | None:
        self.iterations += iterations
        solved = is_solved and bool(np.isfinite(x).all())
        self.status = f"{name}: {'solved' if solved else 'gave up'} in {iterations} iterations"
        return _stagewise(x) if solved else None


def _may_start_afresh(instance: Instance) -> bool:
    """Returns whether fatrop is called once more, with a larger barrier, where its iterations did not suffice.

    Where the release is free, that leads to a third to a half of the solutions that are missed; where it is given, most
    of what is not solved has no solution. In a window of several stages, more iterations lead to more.
    """
    return not (instance.problem.fixes_joints or instance.stages.window or instance.fixed_times)


def _may_begin_again(instance: Instance) -> bool:
    """Returns whether further rows are solved from the initial guess, too, where that from the first solution failed.

    Where the release is given, without a window, 120 of 128 fail again.
    """
    return not instance.problem.fixes_joints or instance.stages.window > 0


def _breaks_no_row(part: StageLayout, x: Vector, arguments: Arguments) -> bool:
    """Returns whether variables keep all their bounds, and those of the rows, up to what counts as violated."""
    if not np.isfinite(x).all():
        return False
    g = _rows_at(part, x, arguments["p"])
    beyond = _beyond(g, arguments["lbg"], arguments["ubg"]), _beyond(x, arguments["lbx"], arguments["ubx"])
    return all(bool(excess.max() <= VIOLATED) for excess in beyond)


def _rows_at(stages: StageLayout, x: Vector, p: Vector) -> Vector:
    """Returns the rows at variables `x`, with parameters `p`."""
    launch = compiled_launch(stages)
    if launch is None:
        return evaluate(transcription(stages).functions["g"], x, p)[0].ravel()
    return launch.rows(x, p)


def _beyond(values: Vector, lower: Vector, upper: Vector) -> Vector:
    """Returns how far values are beyond their bounds; negative within."""
    return np.maximum(lower - values, values - upper)


def _with_path_of(instance: Instance, z: Vector) -> Vector:
    """Returns the parameters with the path of the object that a solution throws."""
    p, release = instance.arguments["p"].copy(), z[instance.stages.launch] * instance.scales
    p[ALL_SHARED.slices["object_path"]] = instance.object_path(release[Q], release[QD])
    return p


def _stagewise(x: Vector) -> Vector:
    """Returns the variables as (N + 1, NZ), the last stage padded with a control of zeros."""
    return np.append(x, np.zeros(NZ - NX)).reshape(-1, NZ)


def _violated_groups(instance: Instance, z: Vector, p: Vector) -> set[str]:
    """Returns the groups of which some row is beyond its bound, with parameters `p`."""
    arguments = instance.arguments
    x = z.ravel()[: len(arguments["x0"])]
    g = _rows_at(instance.stages, x, p)
    beyond = _beyond(g, arguments["lbg"], arguments["ubg"]) > VIOLATED
    violated = {group for group, rows in _rows_by_group(instance.stages).items() if beyond[rows].any()}
    outside = _stagewise(_beyond(x, arguments["lbx"], arguments["ubx"]))[:, Q]
    return violated | ({POSITIONS} if (outside > VIOLATED).any() else set())


@cache
def _rows_kept(part: StageLayout, whole: StageLayout) -> Indices:
    return transcription(part).row_index.within(transcription(whole).row_index)


@cache
def _rows_by_group(whole: StageLayout) -> dict[str, Indices]:
    index = transcription(whole).row_index
    rows = {group: index.rows_of_group(group) for group in whole.groups}
    positions = [index.rows["motion", k][NX + 6 :] for k in index.knots["motion"]]
    return {**rows, POSITIONS: np.concatenate(positions)}


def _free_positions(whole: StageLayout, arguments: Arguments) -> None:
    """Frees joint positions that are not fixed."""
    is_position = np.arange(len(arguments["lbx"])) % NZ < Q.stop
    free = is_position & (arguments["lbx"] != arguments["ubx"])
    rows = _rows_by_group(whole)[POSITIONS]
    for variables, constraints, bound in (("lbx", "lbg", -np.inf), ("ubx", "ubg", np.inf)):
        arguments[variables] = np.where(free, bound, arguments[variables])
        arguments[constraints] = arguments[constraints].copy()
        arguments[constraints][rows] = bound


def _pattern(arguments: Arguments) -> bytes:
    """Returns which variables and rows are fixed (2), bounded (1) or free (0)."""
    lower = np.concatenate([arguments["lbx"], arguments["lbg"]])
    upper = np.concatenate([arguments["ubx"], arguments["ubg"]])
    bounded = np.isfinite(lower) | np.isfinite(upper)
    return (bounded.astype(np.int8) + (lower == upper)).astype(np.int8).tobytes()


def _fatrop_options(stages: StageLayout, fixed_times: bool) -> Options:
    for_times, for_stages = FATROP_FIXED_TIMES if fixed_times else {}, FATROP_SHORT_STAGES if stages.window > 1 else {}
    return FATROP | for_stages | for_times


@lru_cache(maxsize=PATTERNS_KEPT)
def _fatrop(stages: StageLayout, pattern: bytes, options: tuple[tuple[str, float], ...]) -> Any:
    """Returns the solver for one pattern of fixed, bounded and free variables and rows, with fatrop's options.

    casadi 3.8.2 makes fatrop anew where the pattern differs from the call before, and then loses its options: each
    pattern has a solver of its own, built in 7 ms.
    """
    made = transcription(stages)
    index, functions = made.row_index, made.functions
    n = index.stages.stages
    roles = {"nlp_grad_f": ("grad_f", ["grad:f:x"]), "nlp_hess_l": ("hess_l", ["grad:gamma:x", "hess:gamma:x:x"])}
    structure = {"structure_detection": "manual", "N": n, "nx": [NX] * (n + 1), "nu": [NU] * n + [0]}
    settings = {**structure, "ng": index.per_stage, "fatrop": dict(options)}
    return _nlpsol("fatrop", functions, roles, settings)


@cache
def _ipopt(stages: StageLayout) -> Any:
    """Returns the IPOPT solver of the same problem."""
    functions = dict(transcription(stages).functions)
    inputs = x, p, *_ = functions["hess_l"].mx_in()
    functions["upper"] = ca.Function("upper", inputs, [ca.triu(functions["hess_l"](*inputs)[1])])
    both = [functions["f"](x, p), functions["grad_f"](x, p)]
    functions["value_and_grad_f"] = ca.Function("value_and_grad_f", [x, p], both)
    roles = {
        "nlp_grad_f": ("value_and_grad_f", ["f", "grad:f:x"]),
        "nlp_hess_l": ("upper", ["triu:hess:gamma:x:x"]),
    }
    return _nlpsol("ipopt", functions, roles, {"ipopt": {"print_level": 0, "sb": "yes", **IPOPT}})


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
