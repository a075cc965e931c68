"""Textbook profiles: trapezoidal velocity, cubic position, constant acceleration. For the seed's sake, for teaching,
and as baselines.

Every joint starts and arrives with the others; the brake is of the same kind, straight along the release velocity. Of
the limits they know velocity and acceleration alone. Their acceleration steps, so the motion is averaged over the
shortest window that keeps the jerk limit too, with half a window of constant velocity on each side of the release.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds.candidates import POSITION_SLACK, Candidate
from planner.solution import Solution
from planner.timing.smoothing import RawMotion, smooth
from planner.timing.velocity_profiles import (
    cubic_brake,
    linear_brake,
    shortest_cubic,
    shortest_ramp,
    shortest_trapezoid,
    shortest_triangle,
    whole_ticks,
)

Vector = NDArray[np.float64]

PROFILES = {
    "cubic": "cubic position in every joint",
    "trapezoid": "trapezoidal velocity in every joint",
    "ramp": "constant acceleration straight along the release velocity",
}


def solve(problem: ThrowProblem, candidate: Candidate, profile: str = "trapezoid") -> Solution:
    """Returns the shortest motion of the profile through the candidate to rest.

    Args:
        problem: whose start and limits hold.
        candidate: the release state.
        profile: one of `PROFILES`.

    Raises:
        SolverFailed: the profile has no such motion: the run-up of a constant acceleration begins outside the joint
            limits, no cubic is slow enough, or the motion would take too long.
    """
    trajectory, width = smooth(
        problem, candidate, lambda limits, width: _raw(problem, candidate, profile, limits, width)
    )
    status = f"{PROFILES[profile]}, without regard to jerk; averaged over {1e3 * width:.0f} ms to keep the jerk limit"
    return Solution(trajectory, status)


def _raw(problem: ThrowProblem, candidate: Candidate, profile: str, limits: Limits, width: int) -> RawMotion:
    dt, v = problem.dt, candidate.qd
    if problem.ends_at_rest:
        launch = _to_rest(candidate.q - problem.start, profile, limits, dt)
        return RawMotion(launch, np.zeros((width + 1, 6)), np.zeros((1, 6)))
    passage = np.tile(v, (width + 1, 1))
    brake = cubic_brake(v, limits, dt) if profile == "cubic" else linear_brake(v, limits, dt)
    d = candidate.q - v * (width * dt / 2.0) - problem.start
    if profile == "cubic":
        return RawMotion(_sampled(shortest_cubic(d, v, limits, dt), dt), passage, brake)
    if profile == "trapezoid":
        return RawMotion(_sampled(shortest_trapezoid(d, v, limits, dt), dt), passage, brake)
    return RawMotion(_run_up(problem, d, v, limits), passage, brake)


def _to_rest(d: Vector, profile: str, limits: Limits, dt: float) -> Vector:
    """Returns the velocities (N+1, 6) of a move over `d` that ends at rest."""
    v = np.zeros(6)
    if profile == "cubic":
        return _sampled(shortest_cubic(d, v, limits, dt), dt)
    if profile == "trapezoid":
        return _sampled(shortest_trapezoid(d, v, limits, dt), dt)
    return _sampled(shortest_triangle(d, limits, dt), dt)


def _run_up(problem: ThrowProblem, d: Vector, v: Vector, limits: Limits) -> Vector:
    """Returns the velocities (N+1, 6) of a move to where the constant acceleration has to begin, and of it."""
    dt = problem.dt
    ramp = shortest_ramp(v, limits, dt)
    d = d - v * ramp.duration_s / 2.0
    _refuse_outside(problem, problem.start + d)
    move = _sampled(shortest_trapezoid(d, np.zeros(6), limits, dt), dt)
    return np.concatenate([move, _sampled(ramp, dt)[1:]])


def _refuse_outside(problem: ThrowProblem, q: Vector) -> None:
    lower, upper = problem.limits.q_lower, problem.limits.q_upper
    over = np.maximum(lower - q, q - upper)
    i = int(over.argmax())
    if over[i] > POSITION_SLACK:
        name = problem.cell.robot.joint_names[i]
        bounds = f"[{lower[i]:.4g}, {upper[i]:.4g}]"
        raise SolverFailed(f"the run-up would begin with {name} at {q[i]:.4g} rad, outside {bounds} rad")


def _sampled(motion, dt: float) -> Vector:
    count = whole_ticks(motion.duration_s, dt)
    return motion.at(np.arange(count + 1) * dt)[1]
