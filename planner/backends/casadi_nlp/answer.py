"""Answer: from a solution to a trajectory on ticks, through the exact release."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from planner.backends.casadi_nlp.instance import Instance
from planner.backends.casadi_nlp.layout import QD, QDD, TIME, Q, Vector
from planner.backends.casadi_nlp.margins import DEFAULT_MARGINS
from planner.backends.casadi_nlp.release_state import State, corrected, is_close, refined_release
from planner.backends.casadi_nlp.solver import Solver, TooLate
from planner.backends.casadi_nlp.tuning import CORRECTIONS, OVER
from planner.backends.solution import Solution
from planner.errors import SolverFailed
from planner.flight import landing_points, time_of_flight
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.timing import RESERVES, onto_grid
from planner.trajectory import Trajectory, columns_at, join

States = Callable[[Vector], tuple[Vector, Vector, Vector]]

LEAST_TICKS = 4  # [ticks] of a phase: three are needed to reach an end state
EXTRA_TICKS = (0, 1, 2, 3)  # [ticks] given to launch and brake, in turn, until no limit is broken
LIMIT_ROUNDING = 1e-8  # [-] share of a limit that floating point may exceed
SAMPLES_PER_STAGE = 6  # [-] landings evaluated in each stage of the window, once the motion is on ticks
USABLE_TOLERANCE = 0.99  # [-] of the landing tolerance: leaves the certificate something
TINY_M = 1e-9  # [m] keeps a landing error away from zero


@dataclass(frozen=True, eq=False)
class KnotStates:
    """A solution as a motion: its states at the knots, between which jerk is constant.

    Attributes:
        z: variables (N + 1, NZ), in SI units.
        launch: the knot of the release.
    """

    z: Vector
    launch: int

    @property
    def t(self) -> Vector:
        """Times (N + 1,) [s]."""
        return self.z[:, TIME] - self.z[0, TIME]

    @property
    def qdd(self) -> Vector:
        """Accelerations (N + 1, 6) [rad/s^2]."""
        return self.z[:, QDD]

    @property
    def release_time_s(self) -> float:
        """Release time [s]."""
        return float(self.t[self.launch])

    @property
    def duration_s(self) -> float:
        """Time of standstill [s]."""
        return float(self.t[-1])

    @property
    def release(self) -> State:
        """Release state q, qd (6,)."""
        return self.z[self.launch, Q], self.z[self.launch, QD]

    def at(self, t: Vector, /) -> tuple[Vector, Vector, Vector]:
        """Returns q, qd, qdd (k, 6) at times `t` (k,) [s] within the motion."""
        times = self.t
        i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        s = (t - times[i])[:, None]
        q = self.z[i][:, Q]
        qd = self.z[i][:, QD]
        qdd = self.z[i][:, QDD]
        jerk = (self.qdd[i + 1] - qdd) / (times[i + 1] - times[i])[:, None]
        return q + s * (qd + s * (qdd / 2.0 + s * jerk / 6.0)), qd + s * (qdd + s * jerk / 2.0), qdd + s * jerk


def answer(instance: Instance, solver: Solver) -> Solution:
    """Returns the motion of least release time on ticks, with the landings of its release window in the tolerance.

    With a window there are two initial guesses: the seed's and, where that leads nowhere, the throw without the window.

    Raises:
        TooLate: it would release after the solver's `latest_s`.
        SolverFailed: the solver gave up, or no tried number of ticks keeps the joint limits.
    """
    candidate = (instance.candidate.q, instance.candidate.qd)
    try:
        made = _within_window(*_solved(instance, candidate, solver), solver)
    except TooLate:
        raise
    except SolverFailed:
        if not instance.problem.is_robust:
            raise
        _, found = _solved(instance.without_window(), candidate, solver)
        near = instance.from_guess(found, landing_offsets=0.0)
        made = _within_window(*_solved(near, found.release, solver), solver)
    return Solution(made, f"solved in {solver.iterations} iterations", solver.iterations, solver.groups)


def _within_window(instance: Instance, found: KnotStates, solver: Solver) -> Trajectory:
    """Returns a solution's motion on ticks, with the landings of its release window in the tolerance.

    Bringing jerks onto ticks moves the landings, and between the knots nothing holds them. While one is beyond the
    tolerance, the instance is solved again with the landing errors at the knots beside it increased by as much.

    Raises:
        SolverFailed: no tried number of ticks keeps the joint limits.
    """
    made = _on_ticks(instance, found, solver)
    excess = 0.0
    for _ in range(CORRECTIONS if instance.problem.is_robust else 0):
        errors = landing_errors_in_window(instance, made.at, made.release_time_s)
        narrowed = instance.margins.window / DEFAULT_MARGINS.window  # where the certificate found more than was kept
        more = excess_at_knots(errors, narrowed * instance.problem.landing_tolerance_m)
        if not more.any() or not np.isfinite(more).all():
            break
        excess = excess + OVER * more
        moved = errors - landing_errors_in_window(instance, found.at, found.release_time_s)
        instance = instance.from_guess(found, moved[::SAMPLES_PER_STAGE] + excess)
        z = solver.try_solve(instance)
        if z is None:
            break
        found = KnotStates(z, found.launch)
        made = _on_ticks(instance, found, solver)
    return made


def _solved(instance: Instance, release: State, solver: Solver) -> tuple[Instance, KnotStates]:
    """Returns the solution, and the instance that it solves.

    Drag and calibration are those at the given release at first, then at the one that was found.

    Raises:
        SolverFailed: the solver gave up, or the budget is spent.
    """
    instance = corrected(instance, release)
    found = KnotStates(solver.solve(instance), instance.stages.launch)
    for _ in range(CORRECTIONS):
        if is_close(instance, found.release):
            break
        further = replace(corrected(instance, found.release), initial=found.z)
        z = solver.try_solve(further)
        if z is None:
            break
        instance = further
        found = KnotStates(z, found.launch)
    return instance, found


def _on_ticks(instance: Instance, found: KnotStates, solver: Solver) -> Trajectory:
    """Returns the motion on whole ticks, solved again with a larger reserve in the joint limits where it breaks them.

    Raises:
        SolverFailed: with no reserve does a tried number of ticks keep the joint limits.
    """
    for reserve in (*RESERVES[1:], None):
        for made in _tried_ticks(instance, found, solver):
            if _keeps_joint_limits(instance.problem, made):
                return made
        z = None if reserve is None else solver.try_solve(instance.with_reserve(found, reserve))
        if z is None:
            break
        found = KnotStates(z, found.launch)
    raise SolverFailed("the solution does not fit the ticks", solver.iterations)


def _tried_ticks(instance: Instance, found: KnotStates, solver: Solver) -> Iterator[Trajectory]:
    """Yields the motion on as few ticks as hold it and on more, each as it is and solved again for these durations."""
    dt = instance.problem.dt
    launch = least_ticks(found.release_time_s, dt)
    brake = least_ticks(found.duration_s - found.release_time_s, dt) + 1 if instance.stages.brake else 0
    for extra in EXTRA_TICKS:
        ticks = (launch + extra, brake + extra * bool(brake))
        yield _sampled(instance, found, ticks)
        instance = corrected(instance, refined_release(instance, found.release))
        z = solver.try_solve(instance.on_times(found.z, ticks[0] * dt, ticks[1] * dt))
        if z is not None:
            found = KnotStates(z, found.launch)
            yield _sampled(instance, found, ticks)


def _sampled(instance: Instance, found: KnotStates, ticks: tuple[int, int]) -> Trajectory:
    """Returns the motion on whole ticks, exactly through the release state.

    The remainder of a phase to whole ticks is spent at rest: before the launch, and after the brake. A start in motion
    has no rest to spend it in: there the correction onto ticks takes it up, or the solve for whole ticks.

    Args:
        instance: as it was solved.
        found: the solution.
        ticks: of the launch and of the brake; the latter do not count for a move that ends at rest.
    """
    problem = instance.problem
    dt = problem.dt
    jerk_max = problem.limits.jerk_max
    k = found.launch
    zero = np.zeros(6)
    q, qd = refined_release(instance, found.release)
    since_release = found.t - found.release_time_s
    before = dt * np.arange(-ticks[0], 1, dtype=np.float64)
    acceleration = columns_at(before, since_release[: k + 1], found.qdd[: k + 1])
    state = (q, qd, zero if problem.ends_at_rest else found.qdd[k])
    head = onto_grid(problem.start_state, state, acceleration, dt, jerk_max)
    if problem.ends_at_rest:
        return join(head, tuple(x[-1:] for x in head), 1.0 / dt)  # pyright: ignore[reportArgumentType]
    after = dt * np.arange(ticks[1] + 1, dtype=np.float64)
    acceleration = columns_at(after, since_release[k:], found.qdd[k:])
    rest = q + found.z[-1, Q] - found.z[k, Q]
    tail = onto_grid(state, (rest, zero, zero), acceleration, dt, jerk_max)
    return join(head, tail, 1.0 / dt)


def least_ticks(duration_s: float, dt: float) -> int:
    """Returns the least number of ticks of `dt` [s] that a phase is tried with."""
    return max(LEAST_TICKS, math.ceil(duration_s / dt))


def _keeps_joint_limits(problem: ThrowProblem, made: Trajectory) -> bool:
    """Returns whether velocity, acceleration and jerk keep the problem's limits at the ticks."""
    limits = problem.limits
    room = 1.0 + LIMIT_ROUNDING
    pairs = ((made.qd, limits.qd_max), (made.qdd, limits.qdd_max), (made.jerk, limits.jerk_max))
    return all(bool((np.abs(values) <= limit * room).all()) for values, limit in pairs)


def landing_errors_in_window(instance: Instance, states: States, release_s: float) -> Vector:
    """Returns the landing errors of releases in the window, without drag (2 n SAMPLES_PER_STAGE + 1, 2) [m].

    Args:
        instance: its window of 2 n stages.
        states: q, qd, qdd (k, 6) at times (k,) [s].
        release_s: nominal release time on the same clock [s].
    """
    around = instance.problem.release_window_s
    problem = instance.problem
    count = 2 * SAMPLES_PER_STAGE * instance.stages.window + 1
    q, qd, _ = states(release_s + np.linspace(-around, around, count))
    tool = tool_state(problem.cell, q, qd)
    landed = landing_points(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity_at_tool_speed)[:, :2]
    errors = landed - landed[len(landed) // 2]
    if problem.moving is None:
        return errors
    falls_s = time_of_flight(tool.p_WT[:, 2] - problem.plane_z, tool.v_WT[:, 2], problem.gravity_at_tool_speed)
    later_s = np.linspace(-around, around, count) + falls_s - falls_s[len(falls_s) // 2]
    return np.asarray(errors - later_s[:, None] * problem.moving.v_W[:2])


def excess_at_knots(errors: Vector, tolerance_m: float) -> Vector:
    """Returns the landing error beyond the tolerance next to each of the window's knots (2 n + 1, 2) [m].

    Args:
        errors: of `landing_errors_in_window`.
        tolerance_m: of the landing.
    """
    size = np.linalg.norm(errors, axis=1)
    over = errors * np.maximum(1.0 - USABLE_TOLERANCE * tolerance_m / np.maximum(size, TINY_M), 0.0)[:, None]
    starts = range(0, len(errors), SAMPLES_PER_STAGE)
    nearby = [slice(max(i - SAMPLES_PER_STAGE + 1, 0), i + SAMPLES_PER_STAGE) for i in starts]
    return np.array([over[rows][size[rows].argmax()] for rows in nearby])
