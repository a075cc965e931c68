"""Drake's KinematicTrajectoryOptimization: a B-spline of free duration with limits at all times and an end velocity.

It obeys joint limits up to the jerk. Torques, distances and singularities are left to the certificate, because Drake
would need a model of the cell for them. A second solve with a fixed duration puts the release on a tick.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answer import PeerAnswer, PeerMissing, Samples, first_certified, gridded
from planner.problem import ThrowProblem
from planner.seeds import Candidate
from planner.timing import grid_limits

Vector = NDArray[np.float64]

CONTROL_POINTS = 16
ORDER = 4  # cubic pieces: piecewise-constant jerk, as in Fling
DURATION_S = (0.05, 5.0)  # [s] limits


def solve(problem: ThrowProblem) -> PeerAnswer:
    """Returns Drake's motion for a `pose` or `joint` release.

    Raises:
        PeerMissing: Drake is not installed.
    """
    return first_certified(problem, _launch)


def _launch(problem: ThrowProblem, state: Candidate) -> Samples | None:
    found = _optimise(problem, state, DURATION_S, None)
    if found is None:
        return None
    ticks = math.ceil(found[0] / problem.dt)
    fixed = _optimise(problem, state, (ticks * problem.dt, ticks * problem.dt), found[1])
    if fixed is None:
        return None
    spline = fixed[2].MakeDerivative(2)
    times = np.linspace(spline.start_time(), spline.end_time(), ticks + 1)
    return gridded(problem, state, spline.vector_values(times).T)


def _optimise(
    problem: ThrowProblem, state: Candidate, duration: tuple[float, float], initial_guess: Any
) -> tuple[float, Any, Any] | None:
    """Returns duration [s], trajectory as an initial guess, and trajectory; None if SNOPT finds none."""
    try:
        from pydrake.planning import KinematicTrajectoryOptimization
        from pydrake.solvers import SnoptSolver
    except ImportError as error:
        raise PeerMissing("drake is not installed (requirements/bench.txt)") from error
    limits, zero = grid_limits(problem.limits, problem.dt), np.zeros(6)
    spline = (
        KinematicTrajectoryOptimization(6, CONTROL_POINTS, ORDER, max(state.bound_s * 1.2, 0.2))
        if initial_guess is None
        else KinematicTrajectoryOptimization(initial_guess)
    )
    if initial_guess is None:
        line = problem.start[:, None] + np.outer(state.q - problem.start, np.linspace(0.0, 1.0, CONTROL_POINTS))
        spline.get_mutable_prog().SetInitialGuess(spline.control_points(), line)
        spline.get_mutable_prog().SetInitialGuess(spline.duration(), max(state.bound_s * 1.2, 0.2))
    spline.AddDurationCost(1.0)
    spline.AddDurationConstraint(*duration)
    spline.AddPositionBounds(limits.q_lower, limits.q_upper)
    top = np.maximum(limits.qd_max, np.abs(state.qd))
    spline.AddVelocityBounds(-top, top)
    spline.AddAccelerationBounds(-limits.qdd_max, limits.qdd_max)
    spline.AddJerkBounds(-limits.jerk_max, limits.jerk_max)
    spline.AddPathPositionConstraint(problem.start, problem.start, 0.0)
    spline.AddPathPositionConstraint(state.q, state.q, 1.0)
    spline.AddPathVelocityConstraint(zero, zero, 0.0)
    spline.AddPathAccelerationConstraint(zero, zero, 0.0)
    _fix_end_velocity(spline, state.qd)
    result = SnoptSolver().Solve(spline.prog())
    if not result.is_success():
        return None
    motion = spline.ReconstructTrajectory(result)
    return motion.end_time() - motion.start_time(), motion, motion


def _fix_end_velocity(spline: Any, qd: Vector) -> None:
    from pydrake.solvers import Binding, LinearConstraint

    fixed = LinearConstraint(np.eye(6), qd, qd)
    spline.AddVelocityConstraintAtNormalizedTime(Binding[LinearConstraint](fixed, spline.qdot()), 1.0)
