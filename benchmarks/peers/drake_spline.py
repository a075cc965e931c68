"""Drake's KinematicTrajectoryOptimization: a B-spline of free duration with limits at all times and an end velocity.

It plans the launch to one of a few random release states, and obeys joint limits up to the jerk. A second solve with a
fixed duration puts the release on a tick. Torques, tool speed and distances are looked at afterwards. The brake is
Ruckig's.
"""

# Drake's stubs ask for arrays whose shape they do not name.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.arm import PeerArm, Problem
from benchmarks.peers.motions import WITHIN, Answer, answer, braked, is_right, refusal
from benchmarks.peers.releases import ThrowState, release_states

Vector = NDArray[np.float64]

CONTROL_POINTS = 16
ORDER = 4  # cubic pieces: piecewise-constant jerk
DURATION_S = (0.05, 5.0)  # [s] limits
GUESS_S = 0.8  # [s] initial guess
TRIES = 8  # release states
WANTED = 2  # answers, the sooner of which counts


def plan(problem: Problem) -> Answer:
    """Returns the answer to a problem of ThrowBench."""
    arm = PeerArm(problem)
    rate = float(problem["sample_rate_hz"])
    found = []
    for state in release_states(problem, arm, TRIES):
        motion = _throw(arm, rate, state)
        if motion is not None and is_right(arm, rate, *motion):
            found.append(motion)
        if len(found) == WANTED:
            break
    if not found:
        return refusal("no spline to a release state that is clear")
    q, qd, release = min(found, key=lambda motion: motion[2])
    return answer(q, qd, release, rate)


def _throw(arm: PeerArm, rate: float, state: ThrowState) -> tuple[Vector, Vector, int] | None:
    free = _optimise(arm, state, DURATION_S, None)
    if free is None:
        return None
    ticks = math.ceil((free.end_time() - free.start_time()) * rate)
    spline = _optimise(arm, state, (ticks / rate, ticks / rate), free)
    if spline is None:
        return None
    times = np.linspace(spline.start_time(), spline.end_time(), ticks + 1)
    q, qd, qdd = (spline.MakeDerivative(k).vector_values(times).T for k in range(3))
    return braked(arm, rate, q, qd, np.clip(qdd[-1], -WITHIN * arm.qdd_max, WITHIN * arm.qdd_max))


def _optimise(arm: PeerArm, state: ThrowState, duration: tuple[float, float], initial_guess: Any) -> Any:
    """Returns the trajectory; None if SNOPT finds none."""
    from pydrake.planning import KinematicTrajectoryOptimization
    from pydrake.solvers import SnoptSolver

    zero = np.zeros(6)
    if initial_guess is None:
        spline = KinematicTrajectoryOptimization(6, CONTROL_POINTS, ORDER, GUESS_S)
        line = arm.start[:, None] + np.outer(state.q - arm.start, np.linspace(0.0, 1.0, CONTROL_POINTS))
        spline.get_mutable_prog().SetInitialGuess(spline.control_points(), line)
        spline.get_mutable_prog().SetInitialGuess(spline.duration(), GUESS_S)
    else:
        spline = KinematicTrajectoryOptimization(initial_guess)
    spline.AddDurationCost(1.0)
    spline.AddDurationConstraint(*duration)
    spline.AddPositionBounds(arm.q_lower, arm.q_upper)
    for add, most in (
        (spline.AddVelocityBounds, arm.qd_max),
        (spline.AddAccelerationBounds, arm.qdd_max),
        (spline.AddJerkBounds, arm.jerk_max),
    ):
        add(-WITHIN * most, WITHIN * most)
    spline.AddPathPositionConstraint(arm.start, arm.start, 0.0)
    spline.AddPathPositionConstraint(state.q, state.q, 1.0)
    spline.AddPathVelocityConstraint(zero, zero, 0.0)
    spline.AddPathAccelerationConstraint(zero, zero, 0.0)
    _fix_end_velocity(spline, state.qd)
    result = SnoptSolver().Solve(spline.prog())
    return spline.ReconstructTrajectory(result) if result.is_success() else None


def _fix_end_velocity(spline: Any, qd: Vector) -> None:
    from pydrake.solvers import Binding, LinearConstraint

    fixed = LinearConstraint(np.eye(6), qd, qd)
    spline.AddVelocityConstraintAtNormalizedTime(Binding[LinearConstraint](fixed, spline.qdot()), 1.0)
