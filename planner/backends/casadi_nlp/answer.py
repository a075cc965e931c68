"""Answer: from a solution to a trajectory on ticks, through the exact release."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from planner.backends.casadi_nlp.instance import Instance
from planner.backends.casadi_nlp.layout import QD, QDD, STEP, TIME, Q, Vector
from planner.backends.casadi_nlp.margins import DEFAULT_MARGINS
from planner.backends.casadi_nlp.release_state import (
    aimed,
    corrected_at,
    is_free_release_of_measured_arm,
    measured_aim,
    only_lands,
    refined_release,
)
from planner.backends.casadi_nlp.solver import Solver
from planner.errors import SolverFailed
from planner.flight import landing_points
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.solution import Solution
from planner.timing import RESERVES, onto_grid
from planner.trajectory import Trajectory, columns_at, join

States = Callable[[Vector], tuple[Vector, Vector, Vector]]

# [ticks] by which a launch is tried that is shorter than the solution, which trades time for even steps and little jerk
SHORTENED_TICKS = 0.05
SPARE_TICKS = 0.2  # [ticks] beyond that of a brake, or of a launch that needs it: room for bringing jerks onto ticks
LEAST_TICKS = 4  # [ticks] of a phase: three are needed to reach an end state
EXTRA_TICKS = (1, 2, 3)  # [ticks] given to launch and brake where the least number breaks a limit
LIMIT_ROUNDING = 1e-8  # [-] share of a limit that floating point may exceed
DRAG_ROUNDS = 3  # corrections of the aim for drag; each leaves a tenth of the error or less
CORRECTIONS = 3  # [-] further solutions at most for a calibrated arm; each leaves some hundredths of the error
WINDOW_ROUNDS = 3  # further solutions at most that bring the landings of a window back into the tolerance
OVERCORRECTION = 1.5  # [-] of a landing error beyond the tolerance between two knots: correction at the knots
SAMPLES_PER_STAGE = 6  # landings evaluated in each stage of the window, once the motion is on ticks
USABLE_TOLERANCE = 0.99  # [-] of the landing tolerance: leaves the certificate something
# Stages fit a launch no shorter than that share of its guess's, without one that is so many times as long as the mean.
SHORTER = 0.4
UNEVEN = 2.4
TINY_M = 1e-9  # [m] keeps a landing error away from zero


@dataclass(frozen=True, eq=False)
class KnotStates:
    """States of a solution at its knots; jerk is constant between them.

    Attributes:
        t: times (N + 1,) [s].
        q: positions (N + 1, 6) [rad].
        qd: velocities (N + 1, 6) [rad/s].
        qdd: accelerations (N + 1, 6) [rad/s^2].
        launch: the knot of the release.
    """

    t: Vector
    q: Vector
    qd: Vector
    qdd: Vector
    launch: int

    @staticmethod
    def of(z: Vector, launch: int) -> KnotStates:
        """Returns the states of the variables (N + 1, NZ), in SI units."""
        return KnotStates(z[:, TIME] - z[0, TIME], z[:, Q], z[:, QD], z[:, QDD], launch)

    @property
    def release_time_s(self) -> float:
        """Release time [s]."""
        return float(self.t[self.launch])

    @property
    def duration_s(self) -> float:
        """Time of standstill [s]."""
        return float(self.t[-1])

    def at(self, t: Vector, /) -> tuple[Vector, Vector, Vector]:
        """Returns q, qd, qdd (k, 6) at times `t` (k,) [s] within the motion."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        s = (t - self.t[i])[:, None]
        jerk = (self.qdd[i + 1] - self.qdd[i]) / (self.t[i + 1] - self.t[i])[:, None]
        q = self.q[i] + s * (self.qd[i] + s * (self.qdd[i] / 2.0 + s * jerk / 6.0))
        return q, self.qd[i] + s * (self.qdd[i] + s * jerk / 2.0), self.qdd[i] + s * jerk


def solved(instance: Instance, solver: Solver) -> tuple[Instance, Vector]:
    """Returns the variables (N + 1, NZ) of the solution, in SI units, and the instance that it solves.

    For a calibrated arm the instance is corrected and solved again, until the release is that of the measured chain but
    for what `refined_release` corrects within the joint limits.

    Raises:
        SolverFailed: the solver gave up, or the budget is spent.
    """
    z = solver.solve(instance)
    for _ in range(CORRECTIONS if is_free_release_of_measured_arm(instance.problem) else 0):
        found = KnotStates.of(z, instance.stages.launch)
        state = (found.q[found.launch], found.qd[found.launch])
        corrected = corrected_at(instance, state)
        if corrected is None:
            break
        corrected = corrected.from_guess(found, instance.landing_offsets)
        again = solver.try_correction(corrected)
        if again is None:
            break
        instance = corrected
        z = again
    return instance, z


def answer(instance: Instance, z: Vector, solver: Solver) -> Solution:
    """Returns the solution's motion on ticks, with the landings of its release window within the tolerance.

    Bringing jerks onto ticks moves the landings, and between the knots nothing holds them. While one is beyond the
    tolerance, the instance is solved again with the landing errors at the knots beside it increased by as much.

    Args:
        instance: as it was solved.
        z: variables of the solution (N + 1, NZ), in SI units.
        solver: for further solutions.

    Raises:
        SolverFailed: no tried number of ticks keeps the joint limits.
    """
    solution = on_ticks(instance, z, solver)
    excess = 0.0
    for _ in range(WINDOW_ROUNDS if instance.problem.is_robust else 0):
        made = solution.trajectory
        found = KnotStates.of(z, instance.stages.launch)
        errors = landing_errors_in_window(instance, made.at, made.release_time_s)
        narrowed = instance.margins.window / DEFAULT_MARGINS.window  # where the certificate found more than was kept
        more = excess_at_knots(errors, narrowed * instance.problem.landing_tolerance_m)
        if not more.any() or not np.isfinite(more).all():
            break
        excess = excess + OVERCORRECTION * more
        moved = errors - landing_errors_in_window(instance, found.at, found.release_time_s)
        instance = instance.from_guess(found, landing_offsets=moved[::SAMPLES_PER_STAGE] + excess)
        again = solver.try_solve(instance)
        if again is None:
            break
        z = again
        solution = on_ticks(instance, again, solver)
    return solution


def on_ticks(instance: Instance, z: Vector, solver: Solver) -> Solution:
    """Returns the motion on whole ticks, solved again with a larger reserve in the joint limits where it breaks them.

    Raises:
        SolverFailed: with no reserve does a tried number of ticks keep the joint limits.
    """
    status = solver.status
    for reserve in (*RESERVES[1:], None):
        made = _on_fitting_ticks(instance, z, solver)
        if made is not None:
            return Solution(made, status, solver.iterations, solver.groups, _stages_fit(instance, z))
        if reserve is None:
            break
        instance = instance.with_reserve(KnotStates.of(z, instance.stages.launch), reserve)
        again = solver.try_solve(instance)
        if again is None:
            break
        z = again
        status = solver.status
    raise SolverFailed("the solution does not fit the ticks", solver.iterations)


def _stages_fit(instance: Instance, z: Vector) -> bool:
    """Returns whether the launch is about as long as its guess, which bounds the stages, and they are about even."""
    stages = instance.stages
    release_s = float(-z[0, TIME])
    steps = z[: stages.launch - stages.window, STEP]
    is_shorter = release_s < SHORTER * float(instance.steps[: stages.launch].sum())
    return not is_shorter and bool(steps.max() < UNEVEN * steps.mean())


def _on_fitting_ticks(instance: Instance, z: Vector, solver: Solver) -> Trajectory | None:
    """Returns the motion as solved with a wait at rest, solved again for these times, or longer; None if none fits.

    With as few ticks of the launch as may be enough first, then with some time to spare.
    """
    problem = instance.problem
    found = KnotStates.of(z, instance.stages.launch)
    launches = [least_ticks(found.release_time_s, problem.dt, spare) for spare in (-SHORTENED_TICKS, SPARE_TICKS)]
    brake = 0
    if instance.stages.brake:
        brake = least_ticks(found.duration_s - found.release_time_s, problem.dt, SPARE_TICKS)
    for launch in dict.fromkeys(launches):
        made, instance = _through_release(instance, found, (launch, brake))
        if _keeps_joint_limits(problem, made):
            return made
        again = _solved_on_times(instance, z, solver, (launch, brake))
        if again is not None and _keeps_joint_limits(problem, again):
            return again
    for extra in EXTRA_TICKS:
        made, _ = _through_release(instance, found, (launches[-1] + extra, brake + extra * bool(brake)))
        if _keeps_joint_limits(problem, made):
            return made
    return None


def least_ticks(duration_s: float, dt: float, spare: float) -> int:
    """Returns the least number of ticks of `dt` [s] that a phase is tried with, `spare` [ticks] beyond its duration."""
    return max(LEAST_TICKS, math.ceil(duration_s / dt + spare))


def _solved_on_times(instance: Instance, z: Vector, solver: Solver, ticks: tuple[int, int]) -> Trajectory | None:
    """Returns the motion solved again with its times fixed to `ticks`, None if the solver gives up."""
    made = None
    dt = instance.problem.dt
    problem = instance.problem
    for correction in range(1 + (CORRECTIONS if is_free_release_of_measured_arm(problem) else 0)):
        instance = instance.on_times(z, ticks[0] * dt, sum(ticks) * dt)
        again = solver.try_correction(instance) if correction else solver.try_solve(instance)
        if again is None:
            return made
        z = again
        made, instance = _through_release(instance, KnotStates.of(z, instance.stages.launch), ticks)
        if _keeps_joint_limits(problem, made):
            break
    return made


def _through_release(instance: Instance, found: KnotStates, ticks: tuple[int, int]) -> tuple[Trajectory, Instance]:
    """Returns the trajectory through the refined release, and the instance corrected for it.

    Its aim is corrected for the drag, and for what the formulas' arm lacks of a calibrated one.
    """
    problem = instance.problem
    state = (found.q[found.launch], found.qd[found.launch])
    aim = instance.aim if problem.cell.robot.fixed is None else measured_aim(problem, state, instance.aim)
    for _ in range(DRAG_ROUNDS if problem.drag > 0.0 else 1):
        state = refined_release(instance, state, aim)
        aim = measured_aim(problem, state, aim)
    if problem.drag > 0.0:
        state = refined_release(instance, state, aim)
    corrected = replace(instance, aim=aim)
    if is_free_release_of_measured_arm(problem):
        corrected = aimed(instance, state, aim) if only_lands(problem) else replace(corrected, fitted_at=state)
    return _sampled_on_ticks(problem, found, state, ticks), corrected


def _sampled_on_ticks(
    problem: ThrowProblem, found: KnotStates, release: tuple[Vector, Vector], ticks: tuple[int, int]
) -> Trajectory:
    """Returns the motion on whole ticks, exactly through the release state.

    The remainder of a phase to whole ticks is spent at rest: before the launch, and after the brake.

    Args:
        problem: its start, limits and tick.
        found: the solution.
        release: q and qd (6,), refined.
        ticks: of the launch and of the brake; 0 for a move that ends at rest.
    """
    dt = problem.dt
    jerk_max = problem.limits.jerk_max
    k = found.launch
    zero = np.zeros(6)
    (q, qd) = release
    launch = found.t[: k + 1]
    brake = found.t[k:] - found.t[k]
    wait = ticks[0] * dt - float(launch[-1])
    acceleration = columns_at(dt * np.arange(ticks[0] + 1, dtype=np.float64) - wait, launch, found.qdd[: k + 1])
    state = (q, qd, zero if problem.ends_at_rest else found.qdd[k])
    head = onto_grid((problem.start, zero, zero), state, acceleration, dt, jerk_max)
    if problem.ends_at_rest:
        return join(head, tuple(x[-1:] for x in head), 1.0 / dt)  # pyright: ignore[reportArgumentType]
    acceleration = columns_at(dt * np.arange(ticks[1] + 1, dtype=np.float64), brake, found.qdd[k:])
    rest = q + found.q[-1] - found.q[k]
    tail = onto_grid(state, (rest, zero, zero), acceleration, dt, jerk_max)
    return join(head, tail, 1.0 / dt)


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
    return landed - landed[len(landed) // 2]


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
