"""Joint-wise lower bound of the launch time: that of the slowest joint alone, with free acceleration at the release.

Each joint alone is a jerk-, acceleration- and velocity-limited problem from rest to (distance, velocity). Ruckig gives
its minimum time for a fixed final acceleration; a scan and golden sections minimise over that acceleration. Position
limits, torques and all coupling of joints are left out, so the result remains a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import ruckig
from numpy.typing import NDArray

from planner.problem import JointRelease, PoseRelease, ThrowProblem
from planner.seeds import candidates

Vector = NDArray[np.float64]

SCAN = 33  # final accelerations, from -max to max
REFINED = 3  # best scan points, refined between their neighbours
SHRINK = (5.0**0.5 - 1.0) / 2.0  # [-] of an interval that is left after a section
SECTIONS = 22  # per interval: 1/16 of the range * 0.618^22 = 2e-6 of it


def launch_bound(problem: ThrowProblem) -> float | None:
    """Returns the bound [s] of a `joint` or `pose` release, the minimum over its postures; None for other kinds."""
    if not isinstance(problem.release, JointRelease | PoseRelease):
        return None
    states = sorted(candidates(problem), key=lambda c: c.bound_s)
    best = math.inf
    for state in states:
        if state.bound_s >= best:
            break
        best = min(best, state_bound(problem, state.q, state.qd, best))
    return best


def state_bound(problem: ThrowProblem, q: Vector, qd: Vector, enough: float = math.inf) -> float:
    """Returns the bound of one joint state [s].

    Args:
        problem: Gives start and limits.
        q: Joint positions at the release (6,) [rad].
        qd: Joint velocities at the release (6,) [rad/s].
        enough: Stops early once the bound exceeds this [s].
    """
    limits = problem.limits
    slowest = 0.0
    for i in range(6):
        maxima = float(limits.qd_max[i]), float(limits.qdd_max[i]), float(limits.jerk_max[i])
        slowest = max(slowest, joint_bound(float(q[i] - problem.start[i]), float(qd[i]), *maxima))
        if slowest >= enough:
            break
    return slowest


def joint_bound(distance: float, velocity: float, v_max: float, a_max: float, j_max: float) -> float:
    """Returns the minimum time of one joint over all final accelerations [s].

    Args:
        distance: From rest to the release [rad].
        velocity: At the release [rad/s].
        v_max: Velocity limit [rad/s].
        a_max: Acceleration limit [rad/s^2].
        j_max: Jerk limit [rad/s^3].
    """

    def time_with(acceleration: float) -> float:
        return _minimum_time(distance, velocity, acceleration, (v_max, a_max, j_max))

    grid = np.linspace(-a_max, a_max, SCAN)
    times = np.array([time_with(a) for a in grid])
    best = float(times.min())
    for i in np.argsort(times)[:REFINED]:
        for low, high in ((grid[max(i - 1, 0)], grid[i]), (grid[i], grid[min(i + 1, SCAN - 1)])):
            best = min(best, _valley(time_with, float(low), float(high)))
    return best


def _valley(function: Callable[[float], float], low: float, high: float) -> float:
    """Returns the least value found by golden sections between `low` and `high`."""
    best = math.inf
    for _ in range(SECTIONS):
        inner = high - SHRINK * (high - low), low + SHRINK * (high - low)
        left, right = map(function, inner)
        best = min(best, left, right)
        low, high = (low, inner[1]) if left <= right else (inner[0], high)
    return best


def _minimum_time(distance: float, velocity: float, acceleration: float, maxima: tuple[float, float, float]) -> float:
    request = ruckig.InputParameter(1)
    request.current_position = [0.0]
    request.current_velocity = [0.0]
    request.current_acceleration = [0.0]
    request.target_position = [distance]
    request.target_velocity = [velocity]
    request.target_acceleration = [acceleration]
    v_max, a_max, j_max = maxima
    # Ruckig rejects a final velocity above the limit.
    request.max_velocity = [max(v_max, abs(velocity))]
    request.max_acceleration = [a_max]
    request.max_jerk = [j_max]
    motion = ruckig.Trajectory(1)
    try:
        result = ruckig.Ruckig(1).calculate(request, motion)
    except ruckig.RuckigError:
        return math.inf
    return motion.duration if result in (ruckig.Result.Working, ruckig.Result.Finished) else math.inf
