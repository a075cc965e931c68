"""Solver: fatrop on as few rows as are needed.

Most rows of most problems never come near their bounds, and a solve without them takes half the time per iteration and
fails less often. What is left out is evaluated afterwards and, where violated, included in a further solve from there.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from planner.backends.casadi_nlp.fatrop import Options, launch_of
from planner.backends.casadi_nlp.instance import Arguments, Instance
from planner.backends.casadi_nlp.layout import NU, NX, NZ, QD, TIME, Q, StageLayout, Vector
from planner.backends.casadi_nlp.margins import POSITIONS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, Indices, row_index
from planner.backends.casadi_nlp.tuning import MAX_ITERATIONS
from planner.errors import SolverFailed

OUT_OF_TIME = "out of time"
TOLERANCE = 1e-4  # [-, m, rad]
# A row left out is included when it is this far beyond its bound, and what fatrop gives up is a solution if none is.
VIOLATED = 10.0 * TOLERANCE
# What falls below the LU tolerance is dropped where equalities are eliminated: 1e-2 drops what moves a landing by 2 to
# 3 mm, as a jerk does in a stage of 5 ms.
FATROP: Options = {
    "print_level": 0,
    "tolerance": TOLERANCE,
    "mu_init": 1e-3,
    "max_iter": MAX_ITERATIONS,
    "linsol_lu_fact_tol": 1e-3,
}
# With its times fixed, a solution starts close to its optimum, and what takes longer stalls.
FIXED_TIMES: Options = {"mu_init": 1e-4, "max_iter": MAX_ITERATIONS // 3}


class TooLate(SolverFailed):
    """What is solved releases too late to be of use: with more rows, or a window, it would release later still."""


@dataclass(eq=False)
class Solver:
    """The solver calls of one solve.

    Attributes:
        deadline_s: on `time.perf_counter`; no further call, and no iteration, begins after it. None for no deadline.
        groups: rows included so far: of `LAZY_GROUPS`, or `POSITIONS`.
        latest_s: a solution that releases later than this is of no use; infinite for no such time.
        iterations: spent so far.
    """

    deadline_s: float | None
    groups: frozenset[str]
    latest_s: float
    iterations: int = 0

    def solve(self, instance: Instance) -> Vector:
        """Returns the variables (N + 1, NZ) of the solution, in SI units, with the rows that it needs.

        Raises:
            TooLate: it would release after `latest_s`.
            SolverFailed: the solver gave up, or the time is spent.
        """
        arguments = instance.arguments
        while True:
            z = self._with_groups(instance, arguments)
            arguments = {**arguments, "x0": instance.with_object(z), "p": _with_path_of(instance, z)}
            violated = _violated_groups(instance, arguments)
            if violated <= self.groups:
                return z * instance.scales
            self.groups |= violated

    def try_solve(self, instance: Instance) -> Vector | None:
        """Returns as `solve`, None where that fails."""
        try:
            return self.solve(instance)
        except SolverFailed:
            return None

    def _with_groups(self, instance: Instance, arguments: Arguments) -> Vector:
        """Returns the scaled variables (N + 1, NZ) of the solution with the rows that are included.

        What breaks no row where fatrop gives up is a solution, too, if not an optimal one: it often stalls along what
        hardly changes the cost.
        """
        are_times_free = instance.fixed_times is None
        seconds = math.inf if self.deadline_s is None else self.deadline_s - time.perf_counter()
        if seconds <= 0.0:
            raise SolverFailed(OUT_OF_TIME, self.iterations)
        part = instance.stages.with_groups(self.groups)
        reduced = self._reduced(instance, part, arguments)
        latest = self.latest_s / float(instance.scales[TIME]) if are_times_free else np.inf
        options = FATROP if are_times_free else FATROP | FIXED_TIMES
        x, iterations, is_solved, is_late, is_out_of_time = launch_of(part).solve(reduced, options, latest, seconds)
        self.iterations += iterations
        if is_out_of_time:
            raise SolverFailed(OUT_OF_TIME, self.iterations)
        release = -x[TIME]
        if is_late or (is_solved and release > latest):
            raise TooLate(f"would release after {self.latest_s:.3f} s, no sooner than another", self.iterations)
        if release > latest or not (is_solved or _breaks_no_row(part, x, reduced)):
            raise SolverFailed(f"fatrop: gave up in {iterations} iterations", self.iterations)
        return _stagewise(part, x)

    def _reduced(self, instance: Instance, part: StageLayout, arguments: Arguments) -> Arguments:
        """Returns the arguments of the problem without the rows, and the object's variables, that are left out."""
        whole = instance.stages
        reduced = dict(arguments)
        if POSITIONS not in self.groups:
            _free_positions(whole, reduced)
        for name in ("x0", "lbx", "ubx"):  # the object's variables come last
            reduced[name] = reduced[name][: row_index(part).variables]
        for name in ("lbg", "ubg"):
            reduced[name] = reduced[name][_rows_kept(part, whole)]
        return reduced


def _breaks_no_row(part: StageLayout, x: Vector, arguments: Arguments) -> bool:
    """Returns whether variables keep all their bounds, and those of the rows, up to what counts as violated."""
    if not np.isfinite(x).all():
        return False
    g = _rows_at(part, x, arguments["p"])
    beyond = _beyond(g, arguments["lbg"], arguments["ubg"]), _beyond(x, arguments["lbx"], arguments["ubx"])
    return all(bool(excess.max() <= VIOLATED) for excess in beyond)


def _rows_at(stages: StageLayout, x: Vector, p: Vector) -> Vector:
    """Returns the rows at variables `x`, with parameters `p`."""
    return launch_of(stages).rows(x, p)


def _beyond(values: Vector, lower: Vector, upper: Vector) -> Vector:
    """Returns how far values are beyond their bounds; negative within."""
    return np.maximum(lower - values, values - upper)


def _with_path_of(instance: Instance, z: Vector) -> Vector:
    """Returns the parameters with the path of the object that a solution throws."""
    p = instance.arguments["p"].copy()
    release = z[instance.stages.launch] * instance.scales
    p[ALL_SHARED.slices["object_path"]] = instance.object_path(release[Q], release[QD])
    return p


def _stagewise(stages: StageLayout, x: Vector) -> Vector:
    """Returns the variables as (N + 1, NZ), without the object's, the last stage padded with a control of zeros."""
    return np.append(x[: row_index(stages).core], np.zeros(NU)).reshape(-1, NZ)


def _violated_groups(instance: Instance, arguments: Arguments) -> set[str]:
    """Returns the groups of which some row is beyond its bound, at the variables "x0" and parameters "p"."""
    x = arguments["x0"]
    g = _rows_at(instance.stages, x, arguments["p"])
    beyond = _beyond(g, arguments["lbg"], arguments["ubg"]) > VIOLATED
    violated = {group for group, rows in _rows_by_group(instance.stages).items() if beyond[rows].any()}
    outside = _stagewise(instance.stages, _beyond(x, arguments["lbx"], arguments["ubx"]))[:, Q]
    return violated | ({POSITIONS} if (outside > VIOLATED).any() else set())


@cache
def _rows_kept(part: StageLayout, whole: StageLayout) -> Indices:
    return row_index(part).within(row_index(whole))


@cache
def _rows_by_group(whole: StageLayout) -> dict[str, Indices]:
    index = row_index(whole)
    rows = {group: index.rows_of_group[group] for group in whole.groups}
    positions = [index.rows["motion", k][NX + 6 :] for k in index.knots["motion"]]
    return {**rows, POSITIONS: np.concatenate(positions)}


def _free_positions(whole: StageLayout, arguments: Arguments) -> None:
    """Frees joint positions that are not fixed."""
    every = np.arange(len(arguments["lbx"]))
    is_position = (every % NZ < Q.stop) & (every < row_index(whole).core)
    free = is_position & (arguments["lbx"] != arguments["ubx"])
    rows = _rows_by_group(whole)[POSITIONS]
    for variables, constraints, bound in (("lbx", "lbg", -np.inf), ("ubx", "ubg", np.inf)):
        arguments[variables] = np.where(free, bound, arguments[variables])
        arguments[constraints] = arguments[constraints].copy()
        arguments[constraints][rows] = bound
