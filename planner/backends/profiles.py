"""Textbook velocity profiles as a back end: trapezoid, cubic position, constant acceleration.

All joints start and arrive together; the brake has the same shape, straight along the release velocity. The profiles
keep the limits on velocity and acceleration. Their acceleration steps, so the motion is averaged over the narrowest
window that keeps the jerk limit, with half a window of constant velocity on each side of the release.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from planner.backends.solution import Solution
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds import POSITION_SLACK, Candidate
from planner.timing import (
    CubicProfile,
    RawMotion,
    TrapezoidProfile,
    cubic_brake,
    linear_brake,
    shortest_cubic,
    shortest_ramp,
    shortest_trapezoid,
    shortest_triangle,
    smooth,
    whole_ticks,
)

__all__ = ["DESCRIPTIONS", "VARIANTS", "solve"]

Vector = NDArray[np.float64]

DESCRIPTIONS = {  # of each variant, as the plan's status names it
    "cubic": "cubic position in every joint",
    "trapezoid": "trapezoidal velocity in every joint",
    "ramp": "constant acceleration straight along the release velocity",
}
VARIANTS = tuple(DESCRIPTIONS)


def solve(problem: ThrowProblem, candidate: Candidate, variant: str = "trapezoid") -> Solution:
    """Returns the shortest motion with this profile through the candidate to rest.

    Args:
        problem: gives start, limits and tick.
        candidate: the release state.
        variant: one of `VARIANTS`.

    Raises:
        SolverFailed: the run-up of a constant acceleration begins outside the joint limits, no cubic keeps the limits,
            or the motion takes too long.
    """
    trajectory, width = smooth(problem, candidate, partial(_raw, problem, candidate, variant))
    averaged = f"averaged over {1e3 * width:.0f} ms to keep the jerk limit"
    return Solution(trajectory, f"{DESCRIPTIONS[variant]}, without regard to jerk; {averaged}")


def _raw(problem: ThrowProblem, candidate: Candidate, variant: str, limits: Limits, width: int) -> RawMotion:
    """Returns the motion before it is averaged over `width` ticks."""
    dt = problem.dt
    v = np.zeros(6) if problem.ends_at_rest else candidate.qd
    d = candidate.q - v * (width * dt / 2.0) - problem.start
    if variant == "cubic":
        launch = _sampled(shortest_cubic(d, v, limits, dt), dt)
        brake = cubic_brake
    elif variant == "trapezoid":
        launch = _sampled(shortest_trapezoid(d, v, limits, dt), dt)
        brake = linear_brake
    else:
        launch = _run_up(problem, d, v, limits)
        brake = linear_brake
    passage = np.tile(v, (width + 1, 1))
    return RawMotion(launch, passage, passage[:1] if problem.ends_at_rest else brake(v, limits, dt))


def _run_up(problem: ThrowProblem, d: Vector, v: Vector, limits: Limits) -> Vector:
    """Returns the velocities (N+1, 6) of a move to the run-up point and of the constant acceleration from there."""
    dt = problem.dt
    if problem.ends_at_rest:
        return _sampled(shortest_triangle(d, limits, dt), dt)
    ramp = shortest_ramp(v, limits, dt)
    d = d - v * ramp.duration_s / 2.0
    _refuse_outside(problem, problem.start + d)
    move = _sampled(shortest_trapezoid(d, np.zeros(6), limits, dt), dt)
    return np.concatenate([move, _sampled(ramp, dt)[1:]])


def _refuse_outside(problem: ThrowProblem, q: Vector) -> None:
    lower = problem.limits.q_lower
    upper = problem.limits.q_upper
    over = np.maximum(lower - q, q - upper)
    i = int(over.argmax())
    if over[i] > POSITION_SLACK:
        name = problem.cell.robot.joint_names[i]
        bounds = f"[{lower[i]:.4g}, {upper[i]:.4g}]"
        raise SolverFailed(f"the run-up would begin with {name} at {q[i]:.4g} rad, outside {bounds} rad")


def _sampled(motion: CubicProfile | TrapezoidProfile, dt: float) -> Vector:
    """Returns the velocities (N+1, 6) of a profile at its ticks."""
    count = whole_ticks(motion.duration_s, dt)
    return motion.at(dt * np.arange(count + 1, dtype=np.float64))[1]
