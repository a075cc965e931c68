"""Solver: fatrop on as few rows as are needed.

Most rows of most problems never come near their bounds, and a solve without them takes half the time per iteration and
fails less often. What is left out is evaluated afterwards and, where violated, included in a further solve from there.
"""

from __future__ import annotations

import math
import time
from functools import cache

import numpy as np

from planner.backends.casadi_nlp.fatrop import RESTORATIONS, Options, launch_of
from planner.backends.casadi_nlp.instance import Arguments, Instance
from planner.backends.casadi_nlp.layout import NU, NX, NZ, QD, TIME, Q, StageLayout, Vector
from planner.backends.casadi_nlp.margins import POSITIONS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, Indices, transcription
from planner.errors import SolverFailed
from planner.problem import PointRelease, TargetRelease

# What falls below the LU tolerance is dropped where equalities are eliminated. With a smaller one fatrop 1.1.8 raises
# its regularisation without end on one `point` of sixty. Where the landing counts, however, 1e-2 drops what moves it:
# in a stage of 5 ms a jerk does so by 2 to 3 mm. 44 of 52 problems with several stages in half a window did not
# converge with it, and where the jerk is large many with one stage.
FATROP: Options = {"print_level": 0, "tolerance": 1e-4, "mu_init": 1e-3, "max_iter": 120, "linsol_lu_fact_tol": 1e-2}
# Of 3,108 calls 180 leave the cost aside, and 32 of these come to a solution: none of 33 of points, and all but one
# within 30 such iterations, of which those that fail have up to 117.
FATROP |= {RESTORATIONS: 30}
FATROP_LANDING: Options = {"linsol_lu_fact_tol": 1e-3}
# A point starts afresh then: with 120 iterations, seven more of 988 are later than with tighter limits.
FATROP_POINT: Options = {"max_iter": 70, RESTORATIONS: 0}
FATROP_FIXED_TIMES: Options = {"mu_init": 1e-4, "max_iter": 40}  # starts close to its optimum
FATROP_BRAKE: Options = {"max_iter": 40}  # alone: what takes longer hardly ever succeeds
# [-, m, rad] A row left out is included when it is this far beyond its bound, and what fatrop gives up is a solution if
# none is: ten times the tolerance.
VIOLATED = 1e-3
# Guesses that a brake alone is solved from: even braking, so many times as long as in the guess of the motion; or None,
# the brake of that guess. Of 160 brakes that are found from some guess, the first finds 133, and the first three
# find 157.
BRAKE_GUESSES = (3.0, 2.0, 6.0, None)
PATHS_MAX = 2  # [-] further solutions for a path of the object that has moved with the one before


class Solver:
    """The solver calls of one `solve`, with their common budget.

    Attributes:
        iteration_budget: no further call begins when the iterations of all calls reach it.
        deadline_s: on `time.perf_counter`; no further call begins after it. None for no deadline.
        groups: rows included so far: of `LAZY_GROUPS`, or `POSITIONS`.
        latest_s: no further call begins from a solution that releases later than this; infinite for no such time.
        iterations: spent so far.
        status: outcome of the last call.
        is_late: whether a solution released too late, or would have: with more rows, or a window, it would release
            later still.
        has_converged: whether the last call ended at an optimum.
        lacks_brake: whether no brake from a given release was found that is clear of the flight, wherever the joints
            may turn.
    """

    def __init__(
        self,
        iteration_budget: int,
        deadline_s: float | None,
        groups: frozenset[str],
        latest_s: float = math.inf,
    ) -> None:
        self.iteration_budget = iteration_budget
        self.deadline_s = deadline_s
        self.groups = groups
        self.latest_s = latest_s
        self.is_late = False
        self.iterations = 0
        self.status = ""
        self.has_converged = False
        self.lacks_brake = False

    def solve(self, instance: Instance) -> Vector:
        """Returns the variables (N + 1, NZ) of the solution, in SI units.

        Raises:
            SolverFailed: the solver gave up, or the budget is spent.
        """
        z = self.try_solve(instance)
        if z is None:
            raise SolverFailed(self.status, self.iterations)
        return z

    def try_correction(self, instance: Instance) -> Vector | None:
        """Returns as `try_solve`, without a part in the budget: who corrects bounds the number of corrections."""
        spent = self.iterations
        was_late = self.is_late
        z = self.try_solve(instance)
        self.iterations = spent
        self.is_late = was_late
        return z

    def try_solve(self, instance: Instance) -> Vector | None:
        """Returns the solution, in SI units, None where the solver gives up.

        Groups of rows are included as they are violated; the object's path follows each solution. Where the release
        is given, a brake that is clear of the flight is part of the initial guess; without one the solver gives up.
        """
        kept = None
        moved = 0
        awaits_brake = _brakes_first(instance)
        starts = [(instance, instance.arguments)]  # each is solved from where the one before fails
        while starts and not (self.is_late or self._is_spent()):
            instance, arguments = starts.pop(0)
            if awaits_brake and "passing" in self.groups:
                starts = self._starts_with_brake(instance, arguments)
                awaits_brake = False
                continue
            z = self._without_other_groups(instance, arguments)
            if z is None:
                continue
            if self._releases_late(-z[0, TIME] * instance.scales[TIME]):
                return None
            arguments = {**arguments, "x0": instance.with_object(z), "p": _with_path_of(instance, z)}
            violated = _violated_groups(instance, arguments)
            if violated <= self.groups:
                kept = z * instance.scales  # clear of the path of the solution before, at least
                if "passing" not in violated or moved == PATHS_MAX:
                    break
                moved += 1
            self.groups |= violated
            starts = [(instance, arguments)]
        return None if self.is_late else kept

    def _releases_late(self, release_s: float) -> bool:
        """Returns whether a release at `release_s` [s] is too late to be of use, and notes it."""
        if release_s <= self.latest_s:
            return False
        # without an optimum, more iterations might lead to a sooner one
        self._note_lateness(self.has_converged, f"releases after {release_s:.3f} s")
        return True

    def _note_lateness(self, is_late: bool, what: str) -> None:
        self.is_late = is_late
        self.status = f"{what}, no sooner than another"

    def _starts_with_brake(self, instance: Instance, arguments: Arguments) -> list[tuple[Instance, Arguments]]:
        """Returns the starts with rows that keep the brake off the flight: with a brake that is, then as it was.

        It stays as it was where its guess has such a brake, and with wider margins, where the guess mostly is a motion.
        There is no start where no such brake is found.
        """
        unchanged = [(instance, arguments)]
        if "passing" not in _violated_groups(instance, arguments):
            return unchanged
        motion = _stagewise(instance.stages, arguments["x0"]) * instance.scales
        for stretch in BRAKE_GUESSES:
            if self._is_spent():
                return unchanged
            alone = instance.brake_alone(motion, stretch)
            brake = self._without_other_groups(alone, alone.arguments)
            if brake is not None:
                braked = instance.with_brake(motion, brake * alone.scales)
                return [(braked, braked.arguments), *unchanged]
        if not instance.margins.are_default:
            return unchanged
        self.status = f"no brake that is clear of the flight in {self.iterations} iterations"
        self.lacks_brake = POSITIONS not in self.groups
        return []

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
        for name in ("x0", "lbx", "ubx"):  # the object's variables come last
            reduced[name] = reduced[name][: transcription(part).row_index.variables]
        kept = _rows_kept(part, whole)
        reduced["lbg"], reduced["ubg"] = reduced["lbg"][kept], reduced["ubg"][kept]
        options = _fatrop_options(part, instance)
        latest = self._latest_scaled(instance)
        return self._call_fatrop(part, reduced, options, latest)

    def _latest_scaled(self, instance: Instance) -> float:
        """Returns `latest_s` as a solver's variable; infinite where the time of the release is given."""
        is_free = instance.fixed_times is None and instance.stages.launch > 0
        return self.latest_s / float(instance.scales[TIME]) if is_free else math.inf

    def _call_fatrop(self, part: StageLayout, arguments: Arguments, options: Options, latest: float) -> Vector | None:
        """Returns the solution, None where there is none.

        A call is ended, and its lateness noted, as soon as it is clear that it would release after `latest`, scaled.
        What breaks no row where fatrop gives up is a solution, too, if not an optimal one: it often turns on the spot,
        along what hardly changes the cost.
        """
        outcome = launch_of(part).solve(arguments, options, latest)
        x, iterations, self.has_converged, was_late = outcome
        if was_late:
            self.iterations += iterations
            self._note_lateness(True, f"would release after {self.latest_s:.3f} s")
            return None
        is_solved = self.has_converged or _breaks_no_row(part, x, arguments)
        return self._result("fatrop", _stagewise(part, x), iterations, is_solved)

    def _result(self, name: str, z: Vector, iterations: int, is_solved: bool) -> Vector | None:
        self.iterations += iterations
        solved = is_solved and bool(np.isfinite(z).all())
        self.status = f"{name}: {'solved' if solved else 'gave up'} in {iterations} iterations"
        return z if solved else None


def _brakes_first(instance: Instance) -> bool:
    """Returns whether the brake is solved alone before a motion with rows that keep it off the flight.

    Where the release is given, launch and brake meet in its acceleration alone, and most of what is not solved has no
    such brake, or has one far from that of the solution without these rows.
    """
    given = instance.problem.fixes_joints and not instance.stages.window and instance.fixed_times is None
    return given and instance.stages.brake > 0


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
    for name, path in instance.object_paths(release[Q], release[QD]).items():
        p[ALL_SHARED.slices[name]] = path
    return p


def _stagewise(stages: StageLayout, x: Vector) -> Vector:
    """Returns the variables as (N + 1, NZ), without the object's, the last stage padded with a control of zeros."""
    return np.append(x[: transcription(stages).row_index.core], np.zeros(NU)).reshape(-1, NZ)


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
    return transcription(part).row_index.within(transcription(whole).row_index)


@cache
def _rows_by_group(whole: StageLayout) -> dict[str, Indices]:
    index = transcription(whole).row_index
    rows = {group: index.rows_of_group[group] for group in whole.groups}
    positions = [index.rows["motion", k][NX + 6 :] for k in index.knots["motion"]]
    return {**rows, POSITIONS: np.concatenate(positions)}


def _free_positions(whole: StageLayout, arguments: Arguments) -> None:
    """Frees joint positions that are not fixed."""
    every = np.arange(len(arguments["lbx"]))
    is_position = (every % NZ < Q.stop) & (every < transcription(whole).row_index.core)
    free = is_position & (arguments["lbx"] != arguments["ubx"])
    rows = _rows_by_group(whole)[POSITIONS]
    for variables, constraints, bound in (("lbx", "lbg", -np.inf), ("ubx", "ubg", np.inf)):
        arguments[variables] = np.where(free, bound, arguments[variables])
        arguments[constraints] = arguments[constraints].copy()
        arguments[constraints][rows] = bound


def _fatrop_options(part: StageLayout, instance: Instance) -> Options:
    release = instance.problem.release
    is_windowed = part.window > 0
    cases = (
        (is_windowed or isinstance(release, TargetRelease), FATROP_LANDING),
        (not is_windowed and isinstance(release, PointRelease), FATROP_POINT),
        (instance.fixed_times is not None, FATROP_FIXED_TIMES),
        (part.launch == 0, FATROP_BRAKE),
    )
    options = dict(FATROP)
    for applies, changes in cases:
        options |= changes if applies else {}
    return options
